"""What gain design takes from the model terms: hover, linearisation, Lipschitz constants over a flight envelope."""

from __future__ import annotations

import functools
import hashlib
import itertools
from dataclasses import dataclass
from math import cos

import casadi
import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.model_terms import terms
from rotordx.fmus.model_terms.symbols import symbols
from rotordx.fmus.shell.ports import flatten
from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.gains.options import option
from rotordx.gains.rounding import rounded

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Envelope:
    """Flight states over which a Lipschitz constant holds: each quantity up to its largest absolute value."""

    tilt: float = option(0.35, "rad", "largest angle between body z and the vertical", maximum=1.5)
    body_rate: tuple[float, float, float] = option((2.0, 2.0, 1.0), "rad/s", "largest |p|, |q|, |r|")
    loss_of_effectiveness: float = option(
        0.5,
        "1",
        "largest loss of one rotor, made up for by turning it faster: decides the net rotor momentum",
        maximum=0.99,
    )


@dataclass(frozen=True)
class FlightModel:
    """A vehicle near hover; channels are v_z (m/s, down), p, q, r (rad/s), columns the rotors 1..4."""

    hover_speed: Array  #: (4,) rad/s
    jacobian: Array  #: (4, 4) 1/s, d(rate dynamics)/d(channels) in hover
    signatures: (
        Array  #: (4, 4) m/s2, rad/s2, what a total loss of each rotor adds to the channels' derivatives in hover
    )


def flight_model(vehicle: Vehicle) -> FlightModel:
    """Linearise a vehicle in hover."""
    numbers = _numbers(vehicle)
    allocation = _evaluate("allocation", numbers)
    body = vehicle.fill(VehicleParameters)
    squared_speed = np.linalg.solve(allocation, [body.mass * body.gravity, 0.0, 0.0, 0.0])
    hover_speed = rounded(np.sqrt(squared_speed))  # so that equal rotors turn at equal speeds, to the last bit
    level, still = np.zeros(3), np.zeros(4)
    return FlightModel(
        hover_speed=hover_speed,
        jacobian=_evaluate("rate_jacobian", still, level, hover_speed, numbers),
        signatures=_evaluate("fault_signatures", level, hover_speed, numbers),
    )


def rate_lipschitz(vehicle: Vehicle, envelope: Envelope) -> float:
    """Lipschitz constant, 1/s, of the angular accelerations in the body rates, less their linear part in hover.

    It is the largest 2-norm of the Jacobian over the envelope. The Jacobian is affine in the body rates and in the
    rotor speeds (Euler's and the rotors' gyroscopic terms), its norm hence convex, and the largest value is found at a
    corner: three body rates at plus or minus their limit, no rotor or one of them as fast as its loss makes it turn.
    """
    return max(float(np.linalg.norm(matrix, 2)) for matrix in _rate_deviations(vehicle, envelope))


def attitude_lipschitz(vehicle: Vehicle, envelope: Envelope) -> float:
    """Lipschitz constant, 1/s, of [Euler rates; angular accelerations] in the body rates, less the linear part.

    The Euler rates R_eta(roll, pitch) omega deviate from omega by R_eta - I, whose norm depends on roll and pitch
    alone. Its largest value over all attitudes within the tilt is found on a grid of 2 degrees or less; the two blocks
    share the input, so that the norm of the whole is at most the root of the sum of squares of their norms.
    """
    limit = envelope.tilt
    angles = np.linspace(0.0, limit, max(2, int(np.ceil(np.degrees(limit) / 2)) + 1))
    largest = 0.0
    for roll, pitch in itertools.product(angles, angles):
        if cos(roll) * cos(pitch) >= cos(limit) - 1e-12:
            kinematics = _evaluate("euler_rate_jacobian", np.array([roll, pitch, 0.0]))
            largest = max(largest, float(np.linalg.norm(kinematics - np.eye(3), 2)))
    return float(np.hypot(largest, rate_lipschitz(vehicle, envelope)))


def _rate_deviations(vehicle: Vehicle, envelope: Envelope) -> list[Array]:
    numbers, hover = _numbers(vehicle), flight_model(vehicle)
    faster = 1.0 / np.sqrt(1.0 - envelope.loss_of_effectiveness)
    speeds = [hover.hover_speed * (1 + (faster - 1) * unit) for unit in np.vstack((np.zeros(4), np.eye(4)))]
    corners = itertools.product(*((-limit, limit) for limit in envelope.body_rate))
    return [
        _evaluate("rate_jacobian", np.array([0.0, *corner]), np.zeros(3), speed, numbers)[1:, 1:]
        - hover.jacobian[1:, 1:]
        for corner in corners
        for speed in speeds
    ]


def model_terms_hash() -> str:
    """SHA-256 of the C code of all model terms that gain design evaluates: any change of theirs changes it."""
    generator = casadi.CodeGenerator("model_terms.c", {"casadi_int": "int", "cpp": False})
    for function in _functions().values():
        generator.add(function)
    return hashlib.sha256(generator.dump().encode()).hexdigest()


@functools.cache
def _functions() -> dict[str, casadi.Function]:
    """The model terms as functions of numbers; the vehicle is the column of `VehicleParameters`."""
    column, vehicle = symbols(VehicleParameters, "vehicle")
    zeta, euler, body_rate, rotor_speed = (
        casadi.SX.sym(name, size) for name, size in (("zeta", 4), ("euler", 3), ("body_rate", 3), ("rotor_speed", 4))
    )
    dynamics = terms.rate_dynamics(zeta, euler, rotor_speed, vehicle)
    results = {
        "allocation": ([column], terms.allocation(vehicle)),
        "rate_jacobian": ([zeta, euler, rotor_speed, column], casadi.jacobian(dynamics, zeta)),
        "fault_signatures": ([euler, rotor_speed, column], terms.fault_signatures(euler, rotor_speed, vehicle)),
        "euler_rate_jacobian": ([euler], casadi.jacobian(terms.euler_rate(euler, body_rate), body_rate)),
    }
    return {name: casadi.Function(name, arguments, [result]) for name, (arguments, result) in results.items()}


def _evaluate(name: str, *arguments: Array) -> Array:
    return np.array(_functions()[name](*arguments).full())


def _numbers(vehicle: Vehicle) -> Array:
    return np.asarray(flatten(vehicle.fill(VehicleParameters), lambda *values: np.hstack(values)), dtype=float)
