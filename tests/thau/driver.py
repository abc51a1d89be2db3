"""Runs a diagnoser's step over given samples, without FMU and without flight."""

import numpy as np
from casadi import Function

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.shell.ports import flatten, start_values, table, with_starts
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters

DIAGNOSERS = ("thau", "adaptive_thau", "asmto")


def constants(diagnoser: str, vehicle: str, dt: float, **changes) -> np.ndarray:
    """Argument p of a diagnoser's function: step size, vehicle, parameters of its design with changes."""
    own = with_starts(diagnoser_component(diagnoser).parameters[-1], load_design(vehicle, diagnoser)["parameters"])
    assert set(changes) <= {p.name for p in table(own)}
    own = with_starts(own, {name: np.asarray(value).tolist() for name, value in changes.items()})
    body = flatten(load_vehicle(vehicle).fill(VehicleParameters), lambda *values: np.hstack(values))
    return np.hstack([dt, body, start_values(own)])


def run(diagnoser: str, time, inputs, vehicle="f450_plus", function: Function | None = None, **changes) -> dict:
    """Outputs by port, (N,) or (N, size), for samples at `time` (N,) with `inputs` (N, 11) in port order."""
    step = function or diagnoser_function(diagnoser)
    p = constants(diagnoser, vehicle, time[1] - time[0], **changes)
    start = start_function(diagnoser)()["x"]
    rows, state = [], start
    for u, t in zip(np.asarray(inputs), time, strict=True):
        state, outputs = step(state, u, t, p)
        rows.append(outputs.full().ravel())
    return by_port(np.array(rows), diagnoser_component(diagnoser).outputs)


def by_port(values, cls) -> dict:
    """Columns of an array as ports of a class."""
    named, offset = {}, 0
    for p in table(cls):
        named[p.name] = values[:, offset] if p.shape is None else values[:, offset : offset + p.size]
        offset += p.size
    return named


def hovering(time, vehicle="f450_plus") -> np.ndarray:
    """Inputs (N, 11) of a vehicle that hovers and measures nothing but zeros."""
    from rotordx.gains.flight_model import flight_model

    inputs = np.zeros((len(time), 11))
    inputs[:, :4] = flight_model(load_vehicle(vehicle)).hover_speed
    return inputs
