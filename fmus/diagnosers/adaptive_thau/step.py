"""Thau observer with an adaptive estimate of the torque fault.

N. P. Nguyen, S. K. Hong, "Sliding Mode Thau Observer for Actuator Fault Diagnosis of Quadcopter UAVs", (13) and (20)
without sliding term: the observer that the paper compares with (Cen, Noura, Susilo, Younes 2014). The README has every
deviation.
"""

from __future__ import annotations

from casadi import if_else, vertcat

from rotordx.fmus.diagnosers.adaptive_thau.adaptation import (
    AdaptationOutputs,
    AdaptationParameters,
    AdaptationState,
    conclude,
    derivative,
)
from rotordx.fmus.diagnosers.attitude_observer import interval
from rotordx.fmus.diagnosers.interface import Clock, Command, Measured, runge_kutta
from rotordx.fmus.shell.ports import Vector, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class Parameters(AdaptationParameters):
    """Observer, fault law, decision."""


@ports
class State(AdaptationState):
    """Observer, fault estimate, decision."""


@ports
class Outputs(AdaptationOutputs):
    """Verdict, residuals, observer."""


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: x_hat and f_hat together over the step that ends now, then the verdict."""
    known = interval(measured, command, state, vehicle, clock.dt)

    def rate(value: Vector, share: float) -> Vector:
        estimate, fault = value[:6], value[6:]
        error = estimate - known.measured(share)
        return derivative(error, estimate, fault, known.rotor_speed(share), parameters, vehicle)

    start = vertcat(known.estimate, state.torque_fault)
    value = if_else(state.started, runge_kutta(rate, start, clock.dt), start)
    after, outputs = conclude(value[:6], value[6:], known, state, parameters, vehicle, clock)
    return State(**vars(after)), Outputs(**vars(outputs))
