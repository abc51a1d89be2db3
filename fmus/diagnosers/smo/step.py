"""Sliding mode observer of v_z and body rates: the baseline that paper 003 compares itself with.

    x_hat' = A x_hat + B u + xi(x_hat, u) + k e + M sat(e / boundary_layer),    e = y - x_hat

Within the layer the injection k e + M sat(...) cancels what accelerates the vehicle beyond the model; filtered, it is
the estimate of that acceleration.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan

from casadi import fmax, fmin, if_else, vertcat

from rotordx.fmus.diagnosers.interface import Clock, Command, DiagnosisOutputs, Measured, runge_kutta
from rotordx.fmus.diagnosers.known_acceleration import KnownParameters, KnownState, known_acceleration
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class SlidingParameters:
    """Gains of the observer (gains/smo.py), one for each of v_z, p, q, r."""

    linear_gain: Vector = port("1/s", "k, slope of the injection outside the layer", start=(20,) * 4, minimum=0)
    sliding_gain: Vector = port("m/s2, rad/s2", "M", start=(2, 18, 16, 1.5), minimum=0)
    boundary_layer: Vector = port("m/s, rad/s", "half its thickness", start=(0.02, 0.2, 0.2, 0.02), minimum=1e-6)
    filter_time_constant: Vector = port("s", "of the filter of the injection", start=(0.03,) * 4, minimum=1e-4)


@ports
class Parameters(DecisionParameters, KnownParameters, SlidingParameters):
    """Observer, known model, decision (dataclass fields of the last base lead)."""


@ports
class ObserverState:
    """x_hat and the filtered injection."""

    channel_estimate: Vector = port("m/s, rad/s", "x_hat: v_z, p, q, r", start=(0,) * 4)
    acceleration_estimate: Vector = port("m/s2, rad/s2", "filtered injection", start=(0,) * 4)


@ports
class State(DecisionState, ObserverState, KnownState):
    """All of the parts."""


@ports
class Outputs(DiagnosisOutputs):
    """The common outputs, then residual and threshold, then the observer's."""

    residual: Vector = port("m/s2, rad/s2", "acceleration_estimate less its healthy mean: v_z, p, q, r", start=(0,) * 4)
    threshold: Vector = port("m/s2, rad/s2", "margin of a healthy vehicle, NaN until calibrated", start=(nan,) * 4)
    acceleration_estimate: Vector = port(
        "m/s2, rad/s2", "unknown acceleration of v_z, p, q, r: filtered injection", start=(0,) * 4
    )
    output_error: Vector = port("m/s, rad/s", "e: measured less estimated v_z, p, q, r", start=(0,) * 4)
    channel_estimate: Vector = port("m/s, rad/s", "x_hat: v_z, p, q, r", start=(0,) * 4)


def injection(error: Vector, parameters: SlidingParameters) -> Vector:
    """k e + M sat(e / boundary_layer)."""
    saturated = fmax(-1, fmin(1, error / parameters.boundary_layer))
    return parameters.linear_gain * error + parameters.sliding_gain * saturated


def advance_observer(
    state: Vector,
    filtered: Vector,
    measured: Callable[[float], Vector],
    acceleration: Callable[[Vector], Vector],
    parameters: SlidingParameters,
    dt: Scalar,
) -> tuple[Vector, Vector]:
    """(x_hat, filtered injection) after a step of the fourth-order Runge-Kutta method, for any number n of outputs.

    Args:
        state: x_hat (n).
        filtered: filtered injection (n).
        measured: y (n) after a share of the step.
        acceleration: A x + B u + xi(x, u) (n) of a state (n).
    """
    size = state.numel()

    def derivative(value: Vector, share: float) -> Vector:
        x, z = value[:size], value[size:]
        v = injection(measured(share) - x, parameters)
        return vertcat(acceleration(x) + v, (v - z) / parameters.filter_time_constant)

    value = runge_kutta(derivative, vertcat(state, filtered), dt)
    return value[:size], value[size:]


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the observer over the step that ends now, then the decisions at its end."""
    known_state, known = known_acceleration(measured, command, state, parameters, vehicle, clock)
    channels, estimate = advance_observer(
        if_else(state.started, state.channel_estimate, known.after),
        state.acceleration_estimate,
        known.measured,
        known.acceleration,
        parameters,
        clock.dt,
    )
    channels, estimate = if_else(state.started, channels, known.after), if_else(state.started, estimate, 0)

    calibration, deviation, armed = calibrated(estimate, state.started, state, parameters, clock)
    exceeds = exceeds_margin(deviation, parameters)
    verdict, diagnosis = decide(exceeds, deviation, armed, known.signatures, state, parameters, clock)
    outputs = Outputs(
        **vars(diagnosis),
        residual=deviation,
        threshold=if_else(armed, parameters.margin, nan),
        acceleration_estimate=estimate,
        output_error=known.after - channels,
        channel_estimate=channels,
    )
    observer = ObserverState(channels, estimate)
    return State(**vars(known_state), **vars(observer), **vars(calibration), **vars(verdict)), outputs
