"""Ports are the same whether an FMU declares arrays (FMI 3) or spells out their elements (FMI 2)."""

from __future__ import annotations

import dataclasses

import fmpy
import pytest
from foreign_fmu import model_description

from rotordx.fmus import component_names, diagnoser_ids, fmu_path
from rotordx.orchestrator.layout import ComponentSettings
from rotordx.orchestrator.variables import Variable, read_variables


def variables_of(path) -> dict[str, Variable]:
    return read_variables(fmpy.read_model_description(path, validate=False), {}, "component")


@pytest.mark.parametrize("name", [*component_names(), *diagnoser_ids()])
def test_both_versions_of_an_fmu_have_the_same_ports(name):
    two, three = (variables_of(fmu_path(name, fmi)) for fmi in (2, 3))
    three = {port: variable for port, variable in three.items() if variable.causality != "independent"}
    assert list(two) == list(three)
    for port, variable in three.items():
        other = two[port]
        for field in dataclasses.fields(Variable):
            if field.name not in ("type", "access", "elements", "start"):
                assert getattr(other, field.name) == getattr(variable, field.name), (port, field.name)
        assert str(other.start) == str(variable.start), port  # texts, as NaN is not equal to itself
        assert len(other.references) == other.size


@pytest.mark.parametrize(
    "scalars",
    [
        [("a[1]", "input"), ("a[2]", "output")],  # of two causalities
        [("a[2]", "input"), ("a[1]", "input")],  # out of order
        [("a[1]", "input"), ("a[3]", "input")],  # with a gap
    ],
)
def test_what_is_no_whole_array_stays_scalars(scalars, tmp_path):
    path = tmp_path / "modelDescription.xml"
    path.write_text(model_description("a", [(name, causality, 0.0) for name, causality in scalars]))
    assert list(variables_of(str(path))) == [name for name, _ in scalars]


def test_a_scenarios_settings_extend_and_replace_those_of_the_system():
    system = ComponentSettings(
        fmu="plant", actual_vehicle=True, parameters={"mass": 1.0, "seed": 1}, ports={"a": ["b"]}
    )
    scenario = ComponentSettings(fmi=2, parameters={"mass": 2.0}, ports={"c": ["d"]})
    extended = system.extended(scenario)
    assert (extended.fmu, extended.fmi, extended.actual_vehicle) == ("plant", 2, True)
    assert extended.parameters == {"mass": 2.0, "seed": 1}
    assert {name: port.variables for name, port in extended.ports.items()} == {"a": ["b"], "c": ["d"]}


def test_booleans_start_as_0_and_1(tmp_path):
    path = tmp_path / "modelDescription.xml"
    flags = [("off", "parameter", 0.0), ("on", "parameter", 1.0)]
    path.write_text(model_description("a", flags, {"off": "Boolean", "on": "Boolean"}))
    assert [variable.start for variable in variables_of(str(path)).values()] == [(0.0,), (1.0,)]
