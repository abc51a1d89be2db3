"""Flights with both Kalman diagnosers, and the symbolic step of either replayed over what they saw."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.shell.ports import start_values, table, with_starts
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System

IDS = ("askf", "msjfo")
DT = 0.002


@cache
def flown(gusts: bool = True, loss: float = 0.2) -> Recording:
    """Rotor 3 of the circling lab_x fails at 8 s, in 12 s; both diagnosers as they are packaged."""
    scenario = load_scenario("avram_circle").changed(
        diagnosers=list(IDS),
        duration_s=12.0,
        gusts=gusts,
        faults=[{"rotor": 3, "onset_s": 8.0, "loss_of_effectiveness": loss}],
    )
    with System(scenario) as system:
        return fly(scenario, system)


def inputs(recording: Recording) -> np.ndarray:
    """Inputs (N, 11) of every diagnoser in a flight, from the first step on."""
    names = ("controller.rotor_speed_command", "sensors.euler", "sensors.body_rate", "sensors.vertical_velocity")
    columns = [recording.signals[name].reshape(len(recording.time), -1) for name in names]
    return np.hstack(columns)[1:]


def parameters(diagnoser: str, **changes: Any) -> np.ndarray:
    """Argument p of a diagnoser's step on lab_x: step size, vehicle, parameters."""
    vehicle, own = diagnoser_component(diagnoser).parameters
    assert set(changes) <= {p.name for p in table(own)}
    return np.array([DT, *start_values(vehicle), *start_values(with_starts(own, changes))])


def replayed(diagnoser: str, recording: Recording, function: Any = None, **changes: Any) -> dict[str, np.ndarray]:
    """Outputs (N, size) by port of a diagnoser's step, or of a function in its place, over a flight."""
    step = function or diagnoser_function(diagnoser)
    state, p = start_function(diagnoser)()["x"], parameters(diagnoser, **changes)
    rows = []
    for time, u in zip(recording.time[1:], inputs(recording), strict=True):
        state, y = step(state, u, time, p)
        rows.append(np.asarray(y).ravel())
    values, named, offset = np.array(rows), {}, 0
    for port in table(diagnoser_component(diagnoser).outputs):
        named[port.name] = values[:, offset : offset + port.size]
        offset += port.size
    return named
