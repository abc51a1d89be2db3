"""How far an estimate of a healthy vehicle can be off: the margin of a diagnoser, from the step that it flies.

The step of a diagnoser is linearised in hover, where it has converged, behind what turns unknown accelerations into
its measurements (rigid body, velocity filter). If the accelerations stay within `uncertainty`, the estimate stays
within the L1 norm of that path times it (the peak-to-peak gain; nothing smaller is safe for all of them). Sensor noise
adds a multiple of the standard deviation that it leaves in the estimate: white for the gyro, held between captures for
attitude and position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.diagnosers.interface import Command, Inputs, Measured, critically_damped_filter
from rotordx.fmus.shell.ports import flatten, size, start_values, table, with_starts
from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains.flight_model import flight_model
from rotordx.gains.rounding import rounded

Array = NDArray[np.float64]

#: s, until which the step converges in hover, warm-up and calibration included, and for which responses are summed
CONVERGENCE_TIME = 12.0
HORIZON = 6.0

#: an estimate has settled when it stays within so much of its final value
SETTLED = 0.05


@dataclass(frozen=True)
class Responses:
    """Of an estimate (k) to unit impulses, sample by sample."""

    accelerations: Array  #: (N, k, 4), to an acceleration of v_z, p, q, r over one step
    gyro: Array  #: (N, k, 3), to noise of one sample
    attitude: Array  #: (N, k, 3)
    position: Array  #: (N, k, 1), to noise of the vertical position
    step_size: float

    def peak_gain(self) -> Array:
        """L1 norms (k, 4): largest estimate by accelerations within +-1."""
        return np.abs(self.accelerations).sum(axis=0)

    def noise_std(self, sensors: SensorParameters) -> Array:
        """Standard deviations (k) of the estimate by sensor noise, at the worst phase of the captures."""
        held = max(1, round(sensors.motion_capture_period / self.step_size))
        variance = _held_variance(self.gyro, 1).sum(axis=-1) * sensors.gyro_noise_std**2
        variance += _held_variance(self.attitude, held).sum(axis=-1) * sensors.motion_capture_attitude_noise_std**2
        variance += _held_variance(self.position, held).sum(axis=-1) * sensors.motion_capture_position_noise_std**2
        return np.sqrt(variance)

    def settling_time(self) -> Array:
        """Times (k), s, after which the estimate of an acceleration that steps stays within 5 % of it."""
        count = min(self.accelerations.shape[1:])
        steps = np.cumsum(self.accelerations[:, range(count), range(count)], axis=0)
        final = steps[-1]
        unsettled = np.abs(steps - final) > SETTLED * np.abs(final)
        last = np.where(unsettled.any(axis=0), len(steps) - np.argmax(unsettled[::-1], axis=0), 0)
        return last * self.step_size


def _held_variance(response: Array, held: int) -> Array:
    """Largest variance (k, m) over the phases of unit noise that is held for some samples."""
    whole = len(response) // held * held
    phases = []
    for phase in range(held):
        shifted = np.concatenate((np.zeros((phase, *response.shape[1:])), response))[:whole]
        phases.append((shifted.reshape(-1, held, *response.shape[1:]).sum(axis=1) ** 2).sum(axis=0))
    return np.max(phases, axis=0)


def margin(diagnoser: str, vehicle: Vehicle, design: dict[str, Any], estimate: str, options: Any) -> dict[str, Array]:
    """Decision parameters of a diagnoser: `margin` (4) and `settling_time` (4).

    Args:
        diagnoser: its id.
        design: FMU parameters of the diagnoser by port name.
        estimate: output port (4) that estimates unknown accelerations of v_z, p, q, r.
        options: with `uncertainty` (4), `noise_multiple` and `step_size`, as in `fault_models.ObserverOptions`.

    Returns:
        the two parameters; a channel that the diagnoser does not estimate has the margin 0 and settles at once.
    """
    found = responses(diagnoser, vehicle, design, estimate, options.step_size)
    sensors = vehicle.fill(SensorParameters)
    bound = found.peak_gain() @ np.asarray(options.uncertainty) + options.noise_multiple * found.noise_std(sensors)
    return {"margin": rounded(bound, 4), "settling_time": rounded(found.settling_time(), 3)}


def responses(diagnoser: str, vehicle: Vehicle, design: dict[str, Any], estimate: str, step_size: float) -> Responses:
    """Impulse responses of an output port of a diagnoser, linearised in hover."""
    component = diagnoser_component(diagnoser)
    own = with_starts(component.parameters[-1], {name: np.asarray(value).tolist() for name, value in design.items()})
    numbers = np.hstack([step_size, _column(vehicle.fill(VehicleParameters)), start_values(own)])
    rows = _rows(component.outputs, estimate)
    step, start = diagnoser_function(diagnoser), start_function(diagnoser)()
    hover = np.zeros(size(Inputs))
    hover[:4] = flight_model(vehicle).hover_speed
    before, time = ca.MX.sym("before", step.sparsity_in(0)), ca.MX.sym("time")
    advance = ca.Function("advance", [before, time], [step(before, hover, time, numbers)[0]])
    times = step_size * np.arange(round(CONVERGENCE_TIME / step_size))
    state = advance.fold(len(times))(start["x"], times[None]).full().ravel()

    x, u = ca.SX.sym("x", len(state)), ca.SX.sym("u", size(Inputs))
    x_next, y = step(x, u, CONVERGENCE_TIME, numbers)
    jacobians = ca.Function("jacobians", [x, u], [ca.jacobian(a, b) for a in (x_next, y[rows]) for b in (x, u)])
    F, G, H, K = (m.full() for m in jacobians(state, hover))
    world = _World.of(vehicle, step_size)
    return _cascade(world, F, G, H, K, step_size)


@dataclass(frozen=True)
class _World:
    """c+ = A c + B w, u = C c+ + D w: from w = [accelerations (4), gyro (3), attitude (3), position (1)] to inputs."""

    A: Array
    B: Array
    C: Array
    D: Array

    @classmethod
    def of(cls, vehicle: Vehicle, dt: float) -> _World:
        """Rigid body near hover, sampled, and the filter that makes v_z of the vertical position."""
        c, w = ca.SX.sym("c", 10), ca.SX.sym("w", 11)
        height, velocity, rate, euler, filtered = ca.vertsplit(c, [0, 1, 2, 5, 8, 10])
        vertical, angular, gyro, attitude, position = ca.vertsplit(w, [0, 1, 4, 7, 10, 11])
        body = vehicle.fill(VehicleParameters)
        drag = body.drag_coefficient / body.mass  # without it a velocity would last, and look like an acceleration
        after = ca.vertcat(
            height + dt * velocity + dt**2 / 2 * vertical,
            (1 - dt * drag) * velocity + dt * vertical,
            rate + dt * angular,
            euler + dt * rate + dt**2 / 2 * angular,
        )
        bandwidth = vehicle.fill(SensorParameters).velocity_filter_bandwidth
        lagged = critically_damped_filter(filtered[0], filtered[1], after[0] + position, bandwidth, dt)
        c_next = ca.vertcat(after, *lagged)
        measured = Measured(euler=after[5:8] + attitude, body_rate=after[2:5] + gyro, vertical_velocity=lagged[1])
        command = Command(rotor_speed_command=ca.SX.zeros(4))
        u = flatten(Inputs(**vars(command), **vars(measured)), ca.vertcat)
        function = ca.Function("world", [c, w], [ca.jacobian(a, b) for a in (c_next, u) for b in (c, w)])
        return cls(*(m.full() for m in function(np.zeros(10), np.zeros(11))))


def _cascade(world: _World, F: Array, G: Array, H: Array, K: Array, step_size: float) -> Responses:
    """Impulse responses of x+ = F x + G u, y = H x + K u behind the world."""
    count = round(HORIZON / step_size)
    found = np.empty((count, len(H), world.B.shape[1]))
    c, x = world.B, np.zeros((len(F), world.B.shape[1]))
    u = world.D
    for k in range(count):
        found[k] = H @ x + K @ u
        x = F @ x + G @ u
        c, u = world.A @ c, world.C @ c
    accelerations, gyro, attitude, position = np.split(found, [4, 7, 10], axis=2)
    return Responses(accelerations, gyro, attitude, position, step_size)


def _column(instance: Any) -> Array:
    return np.asarray(flatten(instance, lambda *values: np.hstack(values)), dtype=float)


def _rows(cls: type[Any], name: str) -> slice:
    """Where a port lies among all of its class."""
    first = 0
    for p in table(cls):
        if p.name == name:
            return slice(first, first + p.size)
        first += p.size
    raise KeyError(f"{cls.__name__} has no port {name}")
