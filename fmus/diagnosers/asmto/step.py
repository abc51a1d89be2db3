"""Adaptive sliding mode Thau observer of the torque fault.

N. P. Nguyen, S. K. Hong, "Sliding Mode Thau Observer for Actuator Fault Diagnosis of Quadcopter UAVs", (13), (14) and
(20). The sliding term has a boundary layer, its gain a dead zone, a leak and a limit: as printed, it is unstable in
discrete time. The README has every deviation.
"""

from __future__ import annotations

from casadi import fabs, fmax, fmin, if_else, sign, vertcat

from rotordx.fmus.diagnosers.adaptive_thau.adaptation import (
    AdaptationOutputs,
    AdaptationParameters,
    AdaptationState,
    conclude,
    derivative,
)
from rotordx.fmus.diagnosers.attitude_observer import interval
from rotordx.fmus.diagnosers.interface import Clock, Command, Measured, runge_kutta
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

#: Forms of the sliding term: what flies, and (14) as printed.
FORMS = ("boundary_layer", "sign")

#: rad/s2, where n of the sign form ends: it has long diverged by then, but nothing overflows
LARGEST_GAIN = 1e4


@ports
class Parameters(AdaptationParameters):
    """Observer, fault law, decision, sliding term (gains/asmto.py)."""

    sliding_form: Scalar = port("1", "sign is (14) as printed, unstable in discrete time", start=0, choices=FORMS)
    disturbance_direction: Vector = port("1", "E_d", start=(0, 0, 0, 1, 1, 1))
    sliding_surface: Vector = port("1", "F1 of (18), one row", start=(0, 0, 0, 101.8, 101.8, 101.8))
    sliding_rate: Scalar = port("rad/s3", "alpha of (14): growth of n per F1 e_y", start=0.1, minimum=0)
    sliding_leak: Scalar = port("1/s", "n forgets itself", start=0.1, minimum=0)
    sliding_gain_max: Scalar = port("rad/s2", "largest n of the boundary layer", start=1.0, minimum=0)
    boundary_layer: Scalar = port("rad/s", "|F1 e_y| from which on the term is n", start=10.0, minimum=1e-9)
    dead_zone: Scalar = port("rad/s", "|F1 e_y| up to which n does not grow", start=10.0, minimum=0)


@ports
class State(AdaptationState):
    """Observer, fault estimate, decision, sliding gain."""

    sliding_gain: Scalar = port("rad/s2", "n")


@ports
class Outputs(AdaptationOutputs):
    """Verdict, residuals, observer, sliding term."""

    sliding_gain: Scalar = port("rad/s2", "n of (14)")
    sliding_term: Scalar = port("rad/s2", "v of (14), which acts along E_d")


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: x_hat, f_hat and n together over the step that ends now, then the verdict."""
    known = interval(measured, command, state, vehicle, clock.dt)
    direction = parameters.disturbance_direction

    def rate(value: Vector, share: float) -> Vector:
        estimate, fault, gain = value[:6], value[6:9], value[9]
        error = estimate - known.measured(share)
        distance = parameters.sliding_surface.T @ error
        drive = vertcat(direction * sliding_term(distance, gain, parameters), 0, 0, 0)
        smooth = derivative(error, estimate, fault, known.rotor_speed(share), parameters, vehicle)
        return vertcat(smooth + drive, gain_rate(distance, gain, parameters))

    start = vertcat(known.estimate, state.torque_fault, state.sliding_gain)
    value = if_else(state.started, runge_kutta(rate, start, clock.dt), start)
    largest = if_else(parameters.sliding_form == FORMS.index("sign"), LARGEST_GAIN, parameters.sliding_gain_max)
    gain = fmin(fmax(value[9], 0), largest)

    after, outputs = conclude(value[:6], value[6:9], known, state, parameters, vehicle, clock)
    distance = parameters.sliding_surface.T @ (value[:6] - known.measurement)
    term = sliding_term(distance, gain, parameters)
    return State(**vars(after), sliding_gain=gain), Outputs(**vars(outputs), sliding_gain=gain, sliding_term=term)


def sliding_term(distance: Scalar, gain: Scalar, parameters: Parameters) -> Scalar:
    """v of (14), rad/s2, at F1 e_y = distance."""
    saturated = fmax(-1, fmin(1, distance / parameters.boundary_layer))
    return -gain * if_else(parameters.sliding_form == FORMS.index("sign"), sign(distance), saturated)


def gain_rate(distance: Scalar, gain: Scalar, parameters: Parameters) -> Scalar:
    """Time derivative of n, rad/s3: (14), which never falls, or with dead zone and leak."""
    size = fabs(distance)
    bounded = parameters.sliding_rate * fmax(size - parameters.dead_zone, 0) - parameters.sliding_leak * gain
    return if_else(parameters.sliding_form == FORMS.index("sign"), parameters.sliding_rate * size, bounded)
