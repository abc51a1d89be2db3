"""A Python callback sees a flight's signals at the decimation it asks for, and drives external ones."""

from __future__ import annotations

import numpy as np
import pytest

from rotordx.orchestrator.flight import Signals, fly
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System


@pytest.fixture(scope="module")
def open_loop() -> Scenario:
    """Rotor speeds come from outside instead of from the controller."""
    return load_scenario(
        "hover",
        duration_s=0.1,
        faults=[],
        gusts=False,
        connections=[{"from": "external.rotor_speed_command", "to": "esc.rotor_speed_command"}],
    )


@pytest.fixture(scope="module")
def open_loop_system(open_loop):
    with System(open_loop) as system:
        yield system


def test_a_callback_reads_what_is_logged_at_its_time(system, short):
    seen = []
    recording = fly(
        short(),
        system,
        callback=lambda t, s: seen.append((t, s["plant.position"], s["fdie.fault_detected"])),
        callback_decimation=50,
    )
    assert [t for t, _, _ in seen] == [k * 0.002 for k in range(0, 500, 50)]
    assert np.array_equal([p for _, p, _ in seen], recording.signals["plant.position"][:-1:50])
    assert np.array_equal([d[0] for _, _, d in seen], recording.signals["fdie.fault_detected"][:-1:50])


def test_a_callback_drives_external_signals(open_loop, open_loop_system):
    def ramp(time: float, signals: Signals) -> None:
        signals["external.rotor_speed_command"] = 400 + 1000 * time

    flown = fly(open_loop, open_loop_system, callback=ramp, callback_decimation=10).signals
    held = [400 + 1000 * 0.002 * (k // 10 * 10) for k in range(50)]  # set before a step, held until the next call
    assert np.array_equal(flown["external.rotor_speed_command"][1:, 3], held)
    assert np.array_equal(flown["external.rotor_speed_command"][0], np.zeros(4))


def test_recorded_external_signals_are_what_each_step_works_with(open_loop, open_loop_system):
    commands = np.linspace(400.0, 600.0, 51)[:, None] * np.ones(4)
    flown = fly(open_loop, open_loop_system, external={"external.rotor_speed_command": commands}).signals
    assert np.array_equal(flown["external.rotor_speed_command"], commands)
    decay = np.exp(-0.002 / 0.03)
    expected = [commands[0, 0]]  # the esc starts settled on its first command, then lags behind each next one
    for command in commands[1:, 0]:
        expected.append(command + (expected[-1] - command) * decay)
    assert flown["esc.rotor_speed"][:, 0] == pytest.approx(expected, rel=1e-12)


def test_an_output_of_a_component_cannot_be_set(system, short):
    def meddle(time: float, signals: Signals) -> None:
        signals["plant.position"] = 0.0

    with pytest.raises(KeyError, match=r"plant.position cannot be set, only external signals can"):
        fly(short(), system, callback=meddle)


def test_what_a_callback_holds_is_not_changed_behind_its_back(system, short):
    held: list[np.ndarray] = []
    fly(short(), system, callback=lambda t, s: held.append(s["reference.position_reference"]), callback_decimation=100)
    assert len({tuple(position) for position in held}) == len(held)


def test_the_error_of_a_callback_reaches_the_caller(system, short):
    def fail(time: float, signals: Signals) -> None:
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match=r"^mine$"):
        fly(short(), system, callback=fail)


@pytest.mark.parametrize(
    ("external", "message"),
    [
        ({"external.speed": np.zeros((51, 4))}, "external signals must be external.rotor_speed_command, but are"),
        ({"external.rotor_speed_command": np.zeros((50, 4))}, r"has the shape \(50, 4\), but must have \(51, 4\)"),
    ],
)
def test_external_signals_must_fit(open_loop, open_loop_system, external, message):
    with pytest.raises(ValueError, match=message):
        fly(open_loop, open_loop_system, external=external)
