"""When an FMU fails, the error says which one, at what time, in doing what, and what the FMU logged."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from foreign_fmu import build

from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.system import System


def additional(fmu, short, name="extra"):
    return short(components={name: {"fmu": str(fmu)}})


@pytest.mark.parametrize(
    ("step", "message"),
    [
        (
            'if (time > 0.2999) { LOG("lost %d of %s", 3, "pi"); return fmi2Error; }',
            "extra failed at t = 0.3 s in doStep: error: lost 3 of pi",
        ),
        ("if (time > 0.2999) return fmi2Error;", "extra failed at t = 0.3 s in doStep: status error, no message"),
        ("if (time > 0.2999) return fmi2Discard;", "extra failed at t = 0.3 s in doStep: status discard, no message"),
        ("if (time > 0.2999) return fmi2Fatal;", "extra failed at t = 0.3 s in doStep: status fatal, no message"),
        ("if (time > 0.2999) return 77;", "extra failed at t = 0.3 s in doStep: status 77, no message"),
        ("if (time > 0.2999) return -1;", "extra failed at t = 0.3 s in doStep: status -1, no message"),
        ("if (time > 0.2999) return fmi2Pending;", "extra failed at t = 0.3 s in doStep: status pending, no message"),
    ],
)
def test_a_failing_step_is_reported(tmp_path, short, step, message):
    fmu = build(tmp_path, "extra", outputs=["y"], step=step)
    with pytest.raises(ComponentError) as error:
        fly(additional(fmu, short))
    assert str(error.value) == message
    assert (error.value.component, error.value.time) == ("extra", 0.3)


def test_a_failing_initialisation_is_reported(tmp_path, short):
    fmu = build(tmp_path, "extra", outputs=["y"], initialise='LOG("no way"); return fmi2Error;')
    with pytest.raises(ComponentError, match=r"^extra failed at t = 0 s in initialisation: error: no way$"):
        fly(additional(fmu, short))


def test_messages_go_to_the_component_that_logs_them(tmp_path, short):
    for name in ("one", "two"):
        build(tmp_path, name, outputs=["y"], step=f'if (time == 0.1) LOG("I am {name}");')
    scenario = short(components={name: {"fmu": str(tmp_path / f"{name}.fmu")} for name in ("two", "one")})
    with System(scenario) as system:
        for _ in range(2):  # the messages of one flight are not those of the next
            messages = fly(scenario, system).measurements["messages"]
            assert messages == {"one": ["error: I am one"], "two": ["error: I am two"]}


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_value_that_is_not_finite_stops_the_flight_and_is_named(tmp_path, short, fmi):
    fmu = build(tmp_path, "extra", outputs=["y"], step="V(y) = time > 0.3 ? NAN : 0.0;")
    scenario = short(
        diagnosers=["fdie"],
        components={"extra": {"fmu": str(fmu)}, "fdie": {"fmi": fmi}},
        connections=[{"from": "extra.y", "to": "fdie.vertical_velocity"}],
    )
    with pytest.raises(ComponentError, match=r"^fdie failed at t = 0.302 s in setting inputs: .*vertical_velocity"):
        fly(scenario)


def test_a_system_can_fly_again_after_a_failure(tmp_path, short):
    fmu = build(
        tmp_path, "extra", outputs=["y"], parameters={"limit": 0.5}, step="if (time > V(limit)) return fmi2Error;"
    )
    scenario = additional(fmu, short)
    with System(scenario) as system:
        with pytest.raises(ComponentError, match=r"t = 0.502 s"):
            fly(scenario, system)
        patient = {"extra": {"fmu": str(fmu), "parameters": {"limit": 9.0}}}
        assert fly(scenario.changed(components=patient), system).time[-1] == 1.0


def with_changed_entries(fmu: Path, change: Callable[[str, bytes], bytes]) -> Path:
    changed = fmu.with_name("changed.fmu")
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(changed, "w") as target:
        for name in source.namelist():
            target.writestr(name, change(name, source.read(name)))
    return changed


def test_an_fmu_that_refuses_to_instantiate_is_reported(tmp_path, short):
    fmu = build(tmp_path, "extra", outputs=["y"])
    changed = with_changed_entries(fmu, lambda _, content: content.replace(b'guid="foreign"', b'guid="another"'))
    with pytest.raises(
        ComponentError, match=r"^extra failed at t = 0 s in instantiation: Failed to instantiate model$"
    ):
        fly(additional(changed, short))


def test_a_library_that_does_not_load_is_reported(tmp_path, short):
    fmu = build(tmp_path, "extra", outputs=["y"])
    changed = with_changed_entries(fmu, lambda name, content: content[:64] if name.startswith("binaries") else content)
    with pytest.raises(
        ComponentError, match=r"^extra failed at t = 0 s in instantiation: Failed to load shared library"
    ):
        fly(additional(changed, short))
