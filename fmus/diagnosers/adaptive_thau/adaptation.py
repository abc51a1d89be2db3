"""The fault estimate that `adaptive_thau` and `asmto` have in common (Nguyen, Hong 2018, (13), (20) corrected).

    x_hat' = A x_hat + p(x_hat, u) + B (u + f_hat) - K e_y + w,    f_hat' = -Gamma (F2 e_y + leak f_hat)

e_y = y_hat - y, f is a torque. (20) prints the leak with a plus, with which the estimate runs away; the sign in (23) is
wrong too.
"""

from __future__ import annotations

from math import nan

from casadi import SX, if_else, vertcat

from rotordx.fmus.diagnosers.attitude_observer import (
    Interval,
    ObserverOutputs,
    ObserverState,
    model,
    observer_outputs,
    observer_state,
    torque_signatures,
)
from rotordx.fmus.diagnosers.interface import Clock, DiagnosisOutputs, rows
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.diagnosers.thau.gain import ObserverParameters
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

#: Lyapunov matrix P = p I, p = 101.8, over the inertia of lab_x
F2_OF_LAB_X = tuple(101.8 / (0.022, 0.024, 0.040)[i] if j == i + 3 else 0.0 for i in range(3) for j in range(6))


@ports
class AdaptationParameters(DecisionParameters, ObserverParameters):
    """Observer, fault law (gains/adaptive_thau.py), decision."""

    fault_gain: Vector = port("1/(kg.m2)", "F2 of (19), 3x6 by rows", start=F2_OF_LAB_X)
    learning_rate: Vector = port("N2.m2", "diagonal of Gamma", start=(1e-5,) * 3, minimum=0)
    leak: Scalar = port("1/(N.m)", "kappa: the fault estimate forgets itself", start=1.0, minimum=0)


@ports
class AdaptationState(DecisionState, ObserverState):
    """Observer, fault estimate, decision."""

    torque_fault: Vector = port("N.m", "f_hat", start=(0,) * 3)


@ports
class Residuals(DiagnosisOutputs):
    """The residual is the estimated fault itself."""

    residual: Vector = port("rad/s2", "unknown acceleration less its offset: p, q, r", start=(0,) * 3)
    threshold: Vector = port("rad/s2", "margins of p, q, r, NaN until calibrated", start=(nan,) * 3)


@ports
class AdaptationOutputs(ObserverOutputs, Residuals):
    """Verdict, residuals, observer."""


def derivative(
    error: Vector,
    estimate: Vector,
    fault: Vector,
    rotor_speed: Vector,
    parameters: AdaptationParameters,
    vehicle: VehicleParameters,
) -> Vector:
    """Time derivative (9) of x_hat and f_hat without any sliding term; error = y_hat - y (6)."""
    drive = vertcat(SX.zeros(3), fault / vehicle.inertia)
    state_rate = model(estimate, rotor_speed, vehicle) + drive - rows(parameters.observer_gain, 6) @ error
    fault_rate = -parameters.learning_rate * (rows(parameters.fault_gain, 6) @ error + parameters.leak * fault)
    return vertcat(state_rate, fault_rate)


def conclude(
    estimate: Vector,
    fault: Vector,
    known: Interval,
    state: AdaptationState,
    parameters: AdaptationParameters,
    vehicle: VehicleParameters,
    clock: Clock,
) -> tuple[AdaptationState, AdaptationOutputs]:
    """State and outputs after a step that led to x_hat (6) and f_hat (3)."""
    observer = observer_state(estimate, known)
    acceleration = vertcat(0, fault / vehicle.inertia)
    calibration, deviation, armed = calibrated(acceleration, state.started, state, parameters, clock)
    signatures = torque_signatures(known, vehicle)
    exceeds = exceeds_margin(deviation, parameters)
    verdict_state, verdict = decide(exceeds, deviation, armed, signatures, state, parameters, clock)
    outputs = AdaptationOutputs(
        **vars(verdict),
        residual=deviation[1:],
        threshold=if_else(armed, parameters.margin[1:], nan),
        **vars(observer_outputs(observer, acceleration, verdict, known, vehicle)),
    )
    return AdaptationState(**vars(observer), **vars(calibration), **vars(verdict_state), torque_fault=fault), outputs
