"""The attitude system of paper 003, and the cores of `rho_adaptive` and `smo` on it: many flights at once.

    omega' = xi(omega) + J^-1 tau + chi + phi theta,    y = omega + d,    xi: Euler's term

A controller follows the attitudes of an ellipse. The observers are those of the vehicles' diagnosers, in CasADi, for
three outputs and one fault. Everything has one row per flight.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.diagnosers.interface import runge_kutta
from rotordx.fmus.diagnosers.rho_adaptive.estimator import AdaptationParameters, advance_estimator
from rotordx.fmus.diagnosers.rho_adaptive.evaluation import EvaluationParameters, EvaluationState, evaluate
from rotordx.fmus.diagnosers.smo.step import SlidingParameters, advance_observer
from rotordx.fmus.shell.ports import flatten, size, start_values, unflatten
from rotordx.gains.rho_adaptive import NUMERICAL_FLOOR, DetectionModel, DetectionProof, detection_gain

Array = NDArray[np.float64]

#: The paper gives no figures of its vehicle; these are of an F450 of 1.5 kg with its arms in an X.
INERTIA = np.array([0.0123, 0.0123, 0.0224])  # kg.m2
COUPLING = (INERTIA[[1, 2, 0]] - INERTIA[[2, 0, 1]]) / INERTIA  # of xi: times q r, r p, p q
WEIGHT = 1.5 * 9.81  # N
ARM = 0.225 / np.sqrt(2)  # m, of roll and pitch
REACTION = 0.016  # m, reaction torque over thrust

ATTITUDE_GAIN, RATE_GAIN = np.array([40.0, 40.0, 12.0]), np.array([12.0, 12.0, 6.0])  # 1/s2, 1/s
ELLIPSE_AMPLITUDE = np.array([0.25, 0.25, 0.2])  # rad
ELLIPSE_RATE = np.array([1.0, 1.0, 0.5])  # rad/s
ELLIPSE_PHASE = np.array([0.0, np.pi / 2, 0.0])  # rad

UNCERTAINTY = 0.1  # rad/s2, chi of the paper
NOISE = 0.01 * np.sqrt(3)  # rad/s, norm of 0.01 sin(200 t) on three outputs
INITIAL_ERROR = 0.1  # rad/s, epsilon

STEP_SIZE = 0.002  # s
MODIFICATION_RATE = 0.3  # rho_0, in the middle of the paper's range
BODY_RATE = 1.0  # rad/s, up to which kappa_1 holds
CONVERGENCE_RATE = 8.0  # 1/s, lambda of the matrix inequality
WINDOW = 0.2  # s, T1
SLIDING_RATE = 50.0  # 1/s
SLIDING_LINEAR_GAIN = 10.0  # 1/s
SLIDING_GAIN = 30.0  # rad/s2, above what the largest fault of the paper, an additive -0.25 N.m, accelerates by
SLIDING_FLOOR = 1e-2  # rad/s2, where neither uncertainty nor noise give it a margin
SMALLEST_EFFECT = 1e-2  # rad/s2, below which a fault has no effect that could be estimated

PROGRESS_STEPS = 250

#: (flights, ...) from the time, or from the torque (flights, 3)
OfTime = Callable[[float], Array]
OfTorque = Callable[[Array], Array]


def nothing(_: Any) -> Array:
    """No uncertainty, no noise, no fault."""
    return np.zeros(1)


@dataclass(frozen=True)
class Flights:
    """What happens in some flights; what is the same in all may have one row."""

    count: int
    regressor: OfTorque  #: phi (flights, 3), rad/s2
    fault: OfTime = nothing  #: theta (flights, 1)
    uncertainty: OfTime = nothing  #: chi (flights, 3), rad/s2
    noise: OfTime = nothing  #: d (flights, 3), rad/s
    initial_error: Array = field(default_factory=lambda: np.zeros(3))  #: omega - omega_hat at first, rad/s
    reference_phase: Array = field(default_factory=lambda: np.zeros(3))  #: of the ellipse, rad


@dataclass(frozen=True)
class Tuning:
    """Parameters of both observers."""

    gain: Array  #: P (3, 3)
    adaptation: AdaptationParameters  #: numbers, or (flights,) each
    evaluation: EvaluationParameters
    sliding: SlidingParameters
    sliding_margin: float  #: rad/s2, beyond which an element of the injection is a fault


@dataclass(frozen=True)
class Histories:
    """What came out; (steps, flights) unless stated."""

    time: Array  #: (steps,)
    fault: Array
    rate_norm: Array  #: |omega|_inf, rad/s
    estimate: dict[str, Array]  #: theta_hat of `rho_adaptive` and `smo`
    residual: Array  #: J_nu, rad/s
    threshold: Array  #: J_th, rad/s
    detection_time: dict[str, Array]  #: (flights,), NaN if there was none


def lipschitz() -> float:
    """kappa_1 of xi for body rates up to BODY_RATE: the norm of its Jacobian at a corner, 1/s."""
    return float(np.linalg.norm(BODY_RATE * COUPLING[:, None] * (1 - np.eye(3)), 2))


def tuned(
    uncertainty: float,
    noise: float,
    initial_error: float,
    learning_rate: float | Array | None = None,
    modification_norm: float | Array = 0.3,
    sliding_rate: float = SLIDING_RATE,
) -> Tuning:
    """Both observers for the same bounds.

    Args:
        uncertainty: chi, bound on the norm, rad/s2.
        noise: d, bound on the norm, rad/s.
        initial_error: epsilon, rad/s.
        learning_rate: gamma, 1/s2; None: |P|^2, with which the adaptation has a damping ratio of 0.5.
        modification_norm: N.
        sliding_rate: both poles of the sliding mode observer, of its layer and of the filter of its injection, 1/s.
    """
    gain, proof = attitude_gain()
    norm = float(np.linalg.norm(gain, 2))
    evaluation = EvaluationParameters(
        window=WINDOW,
        overshoot=proof.overshoot,
        decay_rate=proof.decay_rate,
        lipschitz=lipschitz(),
        gain_norm=norm,
        uncertainty_bound=uncertainty,
        noise_bound=noise,
        noise_rms=NUMERICAL_FLOOR,
        noise_projection=NUMERICAL_FLOOR,
        initial_error=initial_error,
    )
    rate = norm**2 if learning_rate is None else learning_rate
    adaptation = AdaptationParameters(
        learning_rate=rate, modification_rate=MODIFICATION_RATE, modification_norm=modification_norm
    )
    sliding = SlidingParameters(
        linear_gain=SLIDING_LINEAR_GAIN,
        sliding_gain=SLIDING_GAIN,
        boundary_layer=SLIDING_GAIN / (sliding_rate - SLIDING_LINEAR_GAIN),
        filter_time_constant=1 / sliding_rate,
    )
    peak_gain = 2 * sliding_rate / np.e  # L1 norm from noise to filtered injection; that from uncertainty is 1
    return Tuning(gain, adaptation, evaluation, sliding, max(uncertainty + peak_gain * noise, SLIDING_FLOOR))


@functools.cache
def attitude_gain() -> tuple[Array, DetectionProof]:
    """P and its proof from the matrix inequality that replaces the printed one."""
    model = DetectionModel(("p", "q", "r"), np.zeros((3, 3)), np.eye(3), np.eye(3), lipschitz())
    return detection_gain(model, CONVERGENCE_RATE)


def simulate(
    flights: Flights, tuning: Tuning, duration: float, progress: Callable[[float], None] = lambda part: None
) -> Histories:
    """Fly; the plant is integrated by the fourth-order Runge-Kutta method, torques are held over a step."""
    count, function = flights.count, _system(tuning)
    x, u, x_next, y = (np.zeros((count, n)) for n in (_STATE, _INPUT, _STATE, _OUTPUT))
    buffer, step = function.map(
        count
    ).buffer()  # works on the arrays themselves: conversions would take most of the time
    for k, array in enumerate((x, u)):
        buffer.set_arg(k, array.data)
    for k, array in enumerate((x_next, y)):
        buffer.set_res(k, array.data)
    x[:] = _start()
    x[:, 3:6] = x[:, 6:9] = -flights.initial_error  # both estimates; omega is 0 at first
    torque_input, phi, fault, chi, before, after, law = np.split(u, _INPUT_PARTS, axis=1)
    law[:] = flatten(tuning.adaptation, lambda *columns: np.stack(np.broadcast_arrays(*columns), axis=-1))
    after[:] = flights.noise(0.0)

    time = STEP_SIZE * np.arange(round(duration / STEP_SIZE) + 1, dtype=np.float64)
    attitude, log = np.zeros((count, 3)), np.empty((len(time) - 1, count, _OUTPUT + 2))
    for k, t in enumerate(time[1:]):
        if k % PROGRESS_STEPS == 0:
            progress(k / len(time))
        torque = _torque(t - STEP_SIZE, attitude, x[:, :3], flights.reference_phase)
        torque_input[:], phi[:] = torque / INERTIA, flights.regressor(torque)
        fault[:], chi[:] = flights.fault(t - STEP_SIZE / 2), flights.uncertainty(t - STEP_SIZE / 2)
        before[:] = after
        after[:] = flights.noise(t)
        step()
        attitude += STEP_SIZE * (x[:, :3] + x_next[:, :3]) / 2
        x[:] = x_next
        log[k, :, :-2], log[k, :, -2] = y, fault[:, 0]
        log[k, :, -1] = np.abs(x[:, :3]).max(axis=1)
    estimate, sliding, residual, threshold, alarm, sliding_alarm, truth, norm = np.moveaxis(log, 2, 0)
    alarms = {"rho_adaptive": alarm, "smo": sliding_alarm}
    return Histories(
        time=time[1:],
        fault=truth,
        rate_norm=norm,
        estimate={"rho_adaptive": estimate, "smo": sliding},
        residual=residual,
        threshold=threshold,
        detection_time={name: _first(time[1:], flags) for name, flags in alarms.items()},
    )


#: omega, x_hat, that of the sliding mode observer, its filtered injection, theta_hat, alarm, evaluation
_STATE_PARTS = [3, 6, 9, 12, 13, 14]
_STATE = _STATE_PARTS[-1] + size(EvaluationState)
#: J^-1 tau, phi, theta, chi, noise at both ends of the step, adaptation parameters
_INPUT_PARTS = [3, 6, 7, 10, 13, 16]
_INPUT = _INPUT_PARTS[-1] + size(AdaptationParameters)
#: theta_hat, that of the injection, J_nu, J_th, two alarms
_OUTPUT = 6


def _start() -> Array:
    return np.hstack((np.zeros(_STATE_PARTS[-1]), start_values(EvaluationState)))


def _system(tuning: Tuning) -> ca.Function:
    """(x, u) -> (x+, y) of plant and both observers over a step, for one flight."""
    x, u = ca.SX.sym("x", _STATE), ca.SX.sym("u", _INPUT)
    omega, own, sliding, filtered, theta, alarm, window = ca.vertsplit(x, [0, *_STATE_PARTS, _STATE])
    known, phi, fault, chi, before, after, law = ca.vertsplit(u, [0, *_INPUT_PARTS, _INPUT])

    def acceleration(rate: ca.SX) -> ca.SX:
        return known - ca.cross(rate, ca.DM(INERTIA) * rate) / ca.DM(INERTIA)

    reached = runge_kutta(lambda rate, _: acceleration(rate) + chi + phi * fault, omega, STEP_SIZE)

    def measured(share: float) -> ca.SX:
        return (1 - share) * (omega + before) + share * (reached + after)

    weighted = phi.T / ca.fmax(ca.sumsqr(phi), SMALLEST_EFFECT**2)
    gain, parameters = ca.DM(tuning.gain), unflatten(AdaptationParameters, law)
    own, theta = advance_estimator(
        own, theta, alarm, measured, acceleration, phi, weighted, gain, parameters, STEP_SIZE
    )
    evaluation = unflatten(EvaluationState, window)
    evaluation, residual, threshold = evaluate(measured(1) - own, 1, evaluation, tuning.evaluation, STEP_SIZE)
    alarm = ca.fmax(alarm, residual > threshold)
    theta = alarm * theta

    sliding, filtered = advance_observer(sliding, filtered, measured, acceleration, tuning.sliding, STEP_SIZE)
    sliding_alarm = ca.mmax(ca.fabs(filtered)) > tuning.sliding_margin
    x_next = ca.vertcat(reached, own, sliding, filtered, theta, alarm, flatten(evaluation, ca.vertcat))
    y = ca.vertcat(theta, weighted @ filtered, residual, threshold, alarm, sliding_alarm)
    return ca.Function("system", [x, u], [ca.densify(x_next), ca.densify(y)], {"cse": True})


def _torque(time: float, attitude: Array, rate: Array, phase: Array) -> Array:
    reference = ELLIPSE_AMPLITUDE * np.sin(ELLIPSE_RATE * time + ELLIPSE_PHASE + phase)
    return INERTIA * (ATTITUDE_GAIN * (reference - attitude) - RATE_GAIN * rate)


def _first(time: Array, flags: Array) -> Array:
    """Time of the first flag of each flight, NaN without one."""
    return np.where(flags.any(axis=0), time[np.argmax(flags, axis=0)], np.nan)
