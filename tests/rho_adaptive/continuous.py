"""The observers of `rho_adaptive` and `smo` as differential equations, written anew and integrated to 1e-10.

Attitude is constant, everything else moves smoothly; measurements need not obey any vehicle: an observer is driven by
whatever it gets.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.shell.ports import start_values, table, with_starts
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters

VEHICLE = load_vehicle("lab_x").fill(VehicleParameters)
EULER = np.array([0.15, -0.1, 0.4])
DURATION = 1.2  # s
BANDWIDTH = 20.0  # rad/s
HOVER = 553.7  # rad/s

#: the adaptive law acts from the start, and the modification within the range of the estimate
RHO = {
    "observer_gain": np.array([17, 1, 0, 0, -1, 18, 0.5, 0, 0, 0.5, 19, 0, 0.3, 0, 0, 16]),
    "learning_rate": 80.0,
    "modification_rate": 0.3,
    "modification_norm": 0.2,
    "warm_up_time": 1e9,
}
#: so weak a sliding term that the error leaves the layer now and then
SMO = {
    "linear_gain": np.array([15.0, 20, 20, 18]),
    "sliding_gain": np.array([0.5, 2, 2, 0.4]),
    "boundary_layer": np.array([0.02, 0.05, 0.05, 0.02]),
    "filter_time_constant": np.array([0.05, 0.02, 0.03, 0.08]),
    "warm_up_time": 1e9,
}


def command(t: float) -> np.ndarray:
    """Rotor speeds (4), rad/s; at rest at t = 0."""
    swing = 1 - np.cos(np.array([5.0, 7, 4, 6]) * t)
    return HOVER * (1 + np.array([0.05, -0.03, 0.04, -0.04]) * swing)


def measured(t: float) -> np.ndarray:
    """v_z, p, q, r; m/s and rad/s."""
    return np.array([0.3 * np.sin(3 * t), 0.8 * np.sin(4 * t), 0.6 * np.cos(5 * t), 0.5 * np.sin(2 * t + 1)])


@dataclass(frozen=True)
class Driven:
    """What is known at a time."""

    unlagged: np.ndarray  #: signatures without velocity filter (4, 4)
    signatures: np.ndarray  #: with it (4, 4)
    speed: np.ndarray


def healthy(x: np.ndarray, d: Driven) -> np.ndarray:
    """Newton's and Euler's equations of a quadrotor whose thrust comes through the filter, from its masses and arms."""
    v = VEHICLE
    J, H = np.diag(v.inertia), -v.rotor_inertia * float(v.rotor_direction @ d.speed)
    coupling = -np.cross(x[1:], J @ x[1:] + [0, 0, H])
    thrust, torque = v.thrust_coefficient * d.speed**2, v.torque_coefficient * d.speed**2
    moments = np.array([-v.rotor_y @ thrust, v.rotor_x @ thrust, v.rotor_direction @ torque])
    rates = np.linalg.solve(J, coupling + moments)
    return np.array([v.gravity - v.drag_coefficient / v.mass * x[0] - d.signatures[0].sum(), *rates])


def signatures(speed: np.ndarray) -> np.ndarray:
    """What each rotor's total loss adds to v_z, p, q, r."""
    v = VEHICLE
    thrust, torque = v.thrust_coefficient * speed**2, v.torque_coefficient * speed**2
    down = np.cos(EULER[0]) * np.cos(EULER[1]) / v.mass
    rows = [-down * thrust, -v.rotor_y * thrust, v.rotor_x * thrust, v.rotor_direction * torque]
    return -np.array(rows) / np.array([1, *v.inertia])[:, None]


Observer = Callable[[float, np.ndarray, Driven], np.ndarray]


@functools.cache
def integrated(observer: Observer) -> Callable[[np.ndarray], np.ndarray]:
    """(8, times) at some times, of an observer that starts at the measurement, all else at 0, behind lag and filter."""
    direct = signatures(command(0.0))[0]
    start = np.concatenate([command(0.0), direct, direct, measured(0.0), np.zeros(4)])

    def derivative(t, z):
        speed, first, second, own = z[:4], z[4:8], z[8:12], z[12:]
        full = signatures(speed)
        known = Driven(full, np.vstack([second, full[1:]]), speed)
        lag = (command(t) - speed) / VEHICLE.motor_time_constant
        filtering = BANDWIDTH * np.array([full[0] - first, first - second])
        return np.concatenate([lag, *filtering, observer(t, own, known)])

    options = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12, "dense_output": True}
    solution = solve_ivp(derivative, (0, DURATION), start, **options)
    return lambda times: solution.sol(times)[12:]


def rho_adaptive(t: float, z: np.ndarray, d: Driven) -> np.ndarray:
    """Observer and adaptive law of Theorem 2 with Y = (phi phi^T)^-1."""
    x, theta = z[:4], z[4:]
    phi = d.signatures
    Y = np.linalg.inv(phi @ phi.T)
    nu = measured(t) - x
    norm, N, rho_0 = np.linalg.norm(theta), RHO["modification_norm"], RHO["modification_rate"]
    rho = 0.0 if norm < N else rho_0 * (norm / N - 1) if norm <= 2 * N else rho_0
    gamma = RHO["learning_rate"]
    P = RHO["observer_gain"].reshape(4, 4)
    return np.concatenate([healthy(x, d) + phi @ theta + P @ nu, gamma * phi.T @ Y @ nu - gamma * rho * theta])


def smo(t: float, z: np.ndarray, d: Driven) -> np.ndarray:
    """Observer with saturated injection, and the first-order filter of that injection."""
    x, filtered = z[:4], z[4:]
    e = measured(t) - x
    v = SMO["linear_gain"] * e + SMO["sliding_gain"] * np.clip(e / SMO["boundary_layer"], -1, 1)
    return np.concatenate([healthy(x, d) + v, (v - filtered) / SMO["filter_time_constant"]])


def discrete(name: str, parameters: dict, dt: float) -> dict[str, np.ndarray]:
    """Outputs by name (steps, size) of a diagnoser fed with the same signals, sampled."""
    component = diagnoser_component(name)
    own = with_starts(component.parameters[-1], {k: np.atleast_1d(v).tolist() for k, v in parameters.items()})
    p = [dt, *start_values(VehicleParameters), *start_values(own)]
    step, x = diagnoser_function(name), start_function(name)()["x"]
    rows = []
    for k in range(round(DURATION / dt) + 1):
        y = measured(k * dt)
        values = {"euler": EULER, "body_rate": y[1:], "vertical_velocity": y[:1]}
        values["rotor_speed_command"] = command(max(0.0, (k - 0.5) * dt))  # mid-step
        u = np.concatenate([values[port.name] for port in table(Inputs)])
        x, outputs = step(x, u, k * dt, p)
        rows.append(outputs.full().ravel())
    history, offset, found = np.array(rows), 0, {}
    for port in table(component.outputs):
        found[port.name] = history[:, offset : offset + port.size]
        offset += port.size
    return found


def deviation(name: str, dt: float) -> float:
    """Largest deviation of state and fault estimate, each relative to its own size."""
    observer, parameters, second = {
        "rho_adaptive": (rho_adaptive, RHO, "fault_estimate"),
        "smo": (smo, SMO, "acceleration_estimate"),
    }[name]
    times = dt * np.arange(round(DURATION / dt) + 1)
    exact = integrated(observer)(times).T
    found = discrete(name, parameters, dt)
    pairs = ((found["channel_estimate"], exact[:, :4]), (found[second], exact[:, 4:]))
    return max(float(np.max(np.abs(one - other)) / np.max(np.abs(other))) for one, other in pairs)
