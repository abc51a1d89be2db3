"""A foreign FMU that crashes, hangs or refuses ends its run with name, time and message, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fmi3_fmu import Float64
from fmi3_fmu import build as build_fmi3

from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from tests.orchestrator.foreign_fmu import build

TIMEOUT_S = 0.5
Y = [Float64("y", "output")]


def flight(fmu: Path, **settings) -> Scenario:
    components = {"extra": {"fmu": str(fmu)} | settings}
    return load_scenario("avram_circle", duration_s=0.5, faults=[], components=components)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ("if (time > 0.1999) *(volatile int *)0 = 1;", "it crashed: Segmentation fault"),
        ('if (time > 0.1999) { LOG("out of coffee"); abort(); }', "it crashed: Aborted"),
        ("if (time > 0.1999) exit(3);", "it ended with exit code 3"),
        ("while (time > 0.1999);", "it did not answer within 0.5 s and was stopped (timeout_s)"),
    ],
    ids=["segmentation fault", "abort", "exit", "hang"],
)
def test_an_fmu_that_takes_its_process_along_is_contained_and_can_fly_again(tmp_path, step, message):
    fmu = build(
        tmp_path, "extra", outputs=["y"], parameters={"good": 0.0}, step=f"V(y) = time; if (!V(good)) {{ {step} }}"
    )
    with System(flight(fmu, timeout_s=TIMEOUT_S)) as system:
        with pytest.raises(ComponentError) as error:
            fly(flight(fmu, timeout_s=TIMEOUT_S), system)
        assert str(error.value) == f"extra failed at t = 0.2 s in doStep: {message}"
        flown = fly(flight(fmu, timeout_s=TIMEOUT_S, parameters={"good": 1.0}), system)
    assert flown.signals["extra.y"][-1] == 249 * 0.002


def test_an_fmu_that_crashes_while_it_is_loaded_is_contained(tmp_path):
    fmu = build(tmp_path, "extra", outputs=["y"])
    source = (tmp_path / "extra.c").read_text() + "__attribute__((constructor)) static void load(void) { abort(); }\n"
    fmu = build(tmp_path, "extra", outputs=["y"], source=source)
    with pytest.raises(ComponentError, match=r"^extra failed at t = 0 s in instantiation: it crashed: Aborted$"):
        System(flight(fmu))


def test_isolation_changes_no_bit(tmp_path):
    step = "V(y) += sin(time) * V(u) / 3;"
    fmu = build(tmp_path, "extra", inputs=["u"], outputs=["y"], step=step)
    connections = [{"from": "esc.rotor_speed[2]", "to": "extra.u"}]
    isolated, inside = (fly(flight(fmu, isolate=i).changed(connections=connections)).signals for i in (True, False))
    assert {key: values.tobytes() for key, values in isolated.items()} == {
        key: values.tobytes() for key, values in inside.items()
    }


def test_a_packaged_fmu_can_be_isolated_too():
    scenario = load_scenario("avram_circle", duration_s=0.2, faults=[])
    isolated = scenario.changed(components={"controller": {"isolate": True}, "fdie": {"isolate": True, "fmi": 2}})
    assert {k: v.tobytes() for k, v in fly(isolated).signals.items()} == {
        k: v.tobytes() for k, v in fly(scenario).signals.items()
    }


@pytest.mark.parametrize("isolate", [True, False])
@pytest.mark.parametrize(
    ("status", "messages"),
    [
        ("*v = fmi2True", "it asked for the end of the simulation"),
        ("*v = fmi2False", "it came to t = 0.201 s only, try more substeps"),
        ("return fmi2Error", "status discard, no message"),
    ],
)
def test_a_discarded_step_says_what_the_fmu_tells_about_it(tmp_path, isolate, status, messages):
    source = (
        build(tmp_path, "extra", outputs=["y"], step="if (time > 0.1999) return fmi2Discard;")
        .with_suffix(".c")
        .read_text()
    )
    for name, kind, answer in (("Boolean", "fmi2Boolean", status), ("Real", "double", "*v = 0.201")):
        old = f"UNUSED(fmi2Get{name}Status, const fmi2StatusKind k, {kind} *v)"
        assert old in source
        body = f"{{ {answer}; return fmi2OK; }}"
        source = source.replace(
            old, f"fmi2Status fmi2Get{name}Status(fmi2Component c, const fmi2StatusKind k, {kind} *v) {body}"
        )
    fmu = build(tmp_path, "extra", outputs=["y"], source=source)
    with pytest.raises(ComponentError) as error:
        fly(flight(fmu, isolate=isolate))
    assert str(error.value) == f"extra failed at t = 0.2 s in doStep: {messages}"


@pytest.mark.parametrize("isolate", [True, False])
def test_an_fmu_that_needs_substeps_gets_them(tmp_path, isolate):
    step = "if (h > 0.0011) return fmi2Discard; V(y) += 1; V(last) = time;"
    fmu = build(tmp_path, "extra", outputs=["y", "last"], step=step)
    with pytest.raises(ComponentError, match=r"^extra failed at t = 0 s in doStep: status discard"):
        fly(flight(fmu, isolate=isolate))
    flown = fly(flight(fmu, isolate=isolate, substeps=4)).signals
    assert np.array_equal(flown["extra.y"], 4 * np.arange(251))
    assert flown["extra.last"][-1] == pytest.approx(0.4995, abs=1e-12)


@pytest.mark.parametrize("isolate", [True, False])
def test_a_failure_in_a_substep_tells_its_time(tmp_path, isolate):
    fmu = build(tmp_path, "extra", outputs=["y"], step='if (time > 0.2009) { LOG("enough"); return fmi2Error; }')
    with pytest.raises(ComponentError, match=r"^extra failed at t = 0.201 s in doStep: error: enough$"):
        fly(flight(fmu, isolate=isolate, substeps=2))


def test_an_early_return_is_made_up_for(tmp_path):
    step = "if (h > 0.0016) { *early = fmi3True; *last = time + 0.0005; } *V(y) += *last - time; *V(n) += 1;"
    fmu = build_fmi3(tmp_path, "extra", [*Y, Float64("n", "output")], step)
    flown = fly(flight(fmu)).signals
    np.testing.assert_allclose(flown["extra.y"], 0.002 * np.arange(251), atol=1e-12)
    assert flown["extra.n"][-1] == 500


def test_an_early_return_without_progress_ends_the_run(tmp_path):
    fmu = build_fmi3(tmp_path, "extra", Y, "if (time > 0.1999) { *early = fmi3True; *last = time; }")
    with pytest.raises(ComponentError, match=r"t = 0.2 s in doStep: it returned early without having moved on$"):
        fly(flight(fmu))


def test_an_fmu_may_lack_every_function_that_is_not_needed(tmp_path):
    fmu = build_fmi3(tmp_path, "extra", [*Y, Float64("u", "input")], "*V(y) = 2 * *V(u);")
    scenario = flight(fmu).changed(connections=[{"from": "plant.position[1]", "to": "extra.u"}])
    with System(scenario) as system:
        for _ in range(2):
            flown = fly(scenario, system).signals
            assert np.array_equal(flown["extra.y"][1:], 2 * flown["plant.position"][1:, 0])


def test_a_function_that_is_needed_and_missing_is_named(tmp_path):
    source = build_fmi3(tmp_path, "extra", Y, "").with_suffix(".c").read_text()
    fmu = build_fmi3(tmp_path, "extra", Y, "", source=source.replace("fmi3Reset", "someReset"))
    with pytest.raises(ComponentError, match=r"^extra failed at t = 0 s in instantiation: .*fmi3Reset"):
        System(flight(fmu))


def test_a_function_that_turns_out_to_be_needed_is_named(tmp_path):
    ports = [*Y, Float64("u", "input")]
    source = build_fmi3(tmp_path, "extra", ports, "").with_suffix(".c").read_text()
    fmu = build_fmi3(tmp_path, "extra", ports, "", source=source.replace("fmi3Set##Type", "someSet##Type"))
    scenario = flight(fmu).changed(connections=[{"from": "plant.position[1]", "to": "extra.u"}])
    sentence = r"^extra failed at t = 0 s in setting inputs: its library has no function fmi3SetFloat64$"
    with pytest.raises(ComponentError, match=sentence):
        fly(scenario)
