"""Thau observer of attitude and body rates, whose injection reads the torque fault.

N. P. Nguyen, S. K. Hong, "Sliding Mode Thau Observer for Actuator Fault Diagnosis of Quadcopter UAVs", section 3.1. The
README has every deviation from the paper.
"""

from __future__ import annotations

from math import nan

from casadi import fabs, if_else, logic_or, vertcat

from rotordx.fmus.diagnosers.attitude_observer import (
    ObserverOutputs,
    ObserverState,
    interval,
    model,
    observer_outputs,
    observer_state,
    torque_signatures,
)
from rotordx.fmus.diagnosers.interface import (
    Clock,
    Command,
    DiagnosisOutputs,
    Measured,
    any_of,
    hold_filter,
    rows,
    runge_kutta,
)
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.diagnosers.thau.gain import ObserverParameters
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class Parameters(DecisionParameters, ObserverParameters):
    """Observer, residuals, decision; `margin` is that of the filtered residual."""

    filter_bandwidth: Scalar = port("rad/s", "of the low-pass behind the sensitive residual", start=10.0, minimum=1e-3)
    fast_margin: Vector = port(
        "m/s2, rad/s2", "as margin, of the residual that is not filtered", start=(1,) * 4, minimum=0
    )


@ports
class State(DecisionState, ObserverState):
    """Observer, low-pass, decision."""

    filtered: Vector = port("m/s2, rad/s2", "low-passed injection, v_z, p, q, r", start=(0,) * 4)


@ports
class Residuals(DiagnosisOutputs):
    """Residuals are unknown accelerations: first fast, then low-passed and sensitive."""

    residual: Vector = port(
        "rad/s2",
        "unknown acceleration less its offset: p, q, r, low-passed p, low-passed q, low-passed r",
        start=(0,) * 6,
    )
    threshold: Vector = port("rad/s2", "margins of the residual, NaN until calibrated", start=(nan,) * 6)


@ports
class Outputs(ObserverOutputs, Residuals):
    """Verdict, residuals, observer."""

    filtered_acceleration_fault: Vector = port("m/s2, rad/s2", "acceleration_fault, low-passed", start=(0,) * 4)


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the observer (8) over the step that ends now, then residuals and verdict."""
    known = interval(measured, command, state, vehicle, clock.dt)
    gain = rows(parameters.observer_gain, 6)

    def derivative(estimate: Vector, share: float) -> Vector:
        error = estimate - known.measured(share)
        return model(estimate, known.rotor_speed(share), vehicle) - gain @ error

    advanced = runge_kutta(derivative, known.estimate, clock.dt)
    estimate = if_else(state.started, advanced, known.estimate)
    # C = I: where (y_hat - y)' = 0, the injection is what the model lacks
    fast = vertcat(0, (gain @ (known.measurement - estimate))[3:])
    decay, hold = hold_filter(parameters.filter_bandwidth, clock.dt)
    filtered = decay * state.filtered + hold * parameters.filter_bandwidth * fast

    calibration, deviation, armed = calibrated(filtered, state.started, state, parameters, clock)
    fast_deviation = fast - calibration.offset  # the low-pass does not change a mean
    exceeds = logic_or(any_of(fabs(fast_deviation) > parameters.fast_margin), exceeds_margin(deviation, parameters))
    signatures = torque_signatures(known, vehicle)
    verdict_state, verdict = decide(exceeds, deviation, armed, signatures, state, parameters, clock)

    observer = observer_state(estimate, known)
    outputs = Outputs(
        **vars(verdict),
        residual=vertcat(fast_deviation[1:], deviation[1:]),
        threshold=if_else(armed, vertcat(parameters.fast_margin[1:], parameters.margin[1:]), nan),
        **vars(observer_outputs(observer, fast, verdict, known, vehicle)),
        filtered_acceleration_fault=filtered,
    )
    return State(**vars(observer), **vars(calibration), **vars(verdict_state), filtered=filtered), outputs
