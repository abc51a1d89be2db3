"""A vehicle in hover that an unknown torque turns to and fro: what an observer takes for a fault."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.shell.ports import flatten, start_values, table, with_starts
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains.flight_model import flight_model

Array = NDArray[np.float64]

VEHICLE = "f450_plus"
AMPLITUDE, RATE = 2.0, 10.0  #: rad/s2 and rad/s of the yaw acceleration
DURATION, STEP_SIZE = 10.0, 0.002  #: s


def torque_error(diagnoser: str, changes: Mapping[str, Any], seed: int = 1) -> tuple[Array, Array]:
    """Time (N,), s, and the yaw torque (N,), N.m, that a diagnoser takes for a fault, with sensor noise.

    The packaged plant has gusts, but no sine. Yaw stays within 1.2 degrees, so that the commands of hover will do.

    Args:
        diagnoser: its id.
        changes: FMU parameters other than those of the vehicle's design.
    """
    vehicle = load_vehicle(VEHICLE)
    sensors, design = vehicle.fill(SensorParameters), load_design(VEHICLE, diagnoser)
    assert design is not None, f"{diagnoser} has no design for {VEHICLE}"
    component = diagnoser_component(diagnoser)
    own = with_starts(component.parameters[-1], design["parameters"] | dict(changes))
    column = flatten(vehicle.fill(VehicleParameters), lambda *values: np.hstack(values))
    parameters = np.hstack([STEP_SIZE, column, start_values(own)])
    rng = np.random.default_rng(seed)
    time: Array = STEP_SIZE * np.arange(1, round(DURATION / STEP_SIZE) + 1, dtype=np.float64)
    inputs = np.zeros((len(time), 11))
    inputs[:, :4] = flight_model(vehicle).hover_speed
    inputs[:, 4:7] = sensors.motion_capture_attitude_noise_std * rng.standard_normal((len(time), 3))
    inputs[:, 7:10] = sensors.gyro_noise_std * rng.standard_normal((len(time), 3))
    inputs[:, 6] -= AMPLITUDE / RATE**2 * np.sin(RATE * time)
    inputs[:, 9] -= AMPLITUDE / RATE * np.cos(RATE * time)

    step, state = diagnoser_function(diagnoser), start_function(diagnoser)()["x"]
    names = [name for port in table(component.outputs) for name in port.element_names()]
    yaw, torque = names.index("torque_fault[3]"), np.empty(len(time))
    for k, t in enumerate(time):
        state, outputs = step(state, inputs[k], t, parameters)
        torque[k] = float(outputs[yaw])
    return time, torque
