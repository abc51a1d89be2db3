"""Every FMU is accepted by FMPy's validation and XML schemas, runs alone, and gives the same values elsewhere."""

from __future__ import annotations

import ctypes

import fmpy
import numpy as np
import pytest
from fmi_driver import FMUS, STEP
from fmpy.fmi2 import fmi2LastSuccessfulTime, fmi2Terminated
from fmpy.validation import validate_fmu

from rotordx.fmus import fmu_path
from tests.importers import importer


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_validation_returns_nothing(name, fmi):
    # validate_fmu validates against the XML schema, too
    assert validate_fmu(str(fmu_path(name, fmi))) == []


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_runs_alone(name, fmi):
    result = fmpy.simulate_fmu(str(fmu_path(name, fmi)), stop_time=0.2, step_size=STEP, output_interval=STEP)
    assert len(result) == 101
    assert result["time"][-1] == pytest.approx(0.2)


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_every_variable_says_what_it_is(name, fmi):
    description = fmpy.read_model_description(str(fmu_path(name, fmi)))
    for v in description.modelVariables:
        assert v.description, v.name
        assert v.unit or v.declaredType, v.name
        assert v.start is not None or v.causality in {"output", "independent"}, v.name
    for unit in description.unitDefinitions:
        assert unit.baseUnit is not None or ", " in unit.name, unit.name


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_descriptions_agree_with_the_declarations(name, fmi, instantiate):
    from rotordx.fmus import load_component

    instance = instantiate(name, fmi)
    declared = [(offset, causality, p) for offset, causality, p in load_component(name).variables()]
    assert list(instance.ports) == [p.name for _, _, p in declared]
    for offset, causality, p in declared:
        port = instance.ports[p.name]
        assert port.references == list(range(offset, offset + p.size))
        assert port.elements == p.element_names()
        assert port.causality == causality
        assert port.enumeration == bool(p.choices)
        if causality != "output":
            assert tuple(port.start) == p.start
            assert tuple(instance.get(p.name)) == p.start


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_model_identifier_is_the_name(name, fmi, instantiate):
    assert instantiate(name, fmi).description.coSimulation.modelIdentifier == name


def test_fmi2_reports_the_time_reached(instantiate):
    instance = instantiate("null", 2)
    instance.initialise(start_time=1.5)
    instance.step(3 * STEP)
    time, terminated = ctypes.c_double(), ctypes.c_int(1)
    instance.fmu.fmi2GetRealStatus(instance.fmu.component, fmi2LastSuccessfulTime, time)
    assert time.value == 1.5 + 3 * STEP
    instance.fmu.fmi2GetBooleanStatus(instance.fmu.component, fmi2Terminated, terminated)
    assert terminated.value == 0


def test_fmi3_reports_the_time_reached(instantiate):
    instance = instantiate("null", 3)
    [time] = [v for v in instance.description.modelVariables if v.causality == "independent"]
    instance.initialise(start_time=1.5)
    assert instance.fmu.getFloat64([time.valueReference]) == [1.5]
    assert instance.fmu.doStep(1.5, 3 * STEP) == (False, False, False, 1.5 + 3 * STEP)
    assert instance.fmu.getFloat64([time.valueReference]) == [1.5 + 3 * STEP]


def run_in_ecos(name, inputs, outputs, steps):
    """Final outputs of an FMU in Ecos, which has an FMI implementation of its own; all values by element name."""
    ecospy = importer("ecospy")
    with ecospy.EcosSimulationStructure() as structure:
        structure.add_model("fmu", fmu_path(name, 2))
        with ecospy.EcosSimulation(step_size=STEP, structure=structure) as simulation:
            simulation.init()
            for element, value in inputs.items():
                simulation.set_real(f"fmu::{element}", value)
            simulation.step(steps)
            return {element: simulation.get_real(f"fmu::{element}") for element in outputs}


def test_another_importer_gives_the_same_final_values(instantiate):
    instance = instantiate("fdie", 2)
    # one rotor is told to turn fast, and the vehicle does not
    constant = {"rotor_speed_command": [650.0, 500.0, 500.0, 500.0], "body_rate": [0.1, 0.0, -0.1]}
    instance.initialise()
    for port, values in constant.items():
        instance.set(port, values)
    steps = 2000
    for _ in range(steps):
        instance.step()
    inputs = {e: v for port in constant for e, v in zip(instance.ports[port].elements, constant[port], strict=True)}
    outputs = {
        e: v
        for port, values in instance.all("output").items()
        for e, v in zip(instance.ports[port].elements, values, strict=True)
    }

    elsewhere = run_in_ecos("fdie", inputs, outputs, steps)
    np.testing.assert_array_equal(list(elsewhere.values()), list(outputs.values()))
    assert outputs["fault_detected"] == 1, "the comparison is of something that happens"
