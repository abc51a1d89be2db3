"""What the estimators know about one step: f, h_s and the uncertainty bound, matched to motor lag and velocity filter.

The measured vertical velocity lags the true one by the filter F = w0^2 / (s + w0)^2 of (33), the rotor speed lags its
command. The estimators must not see these lags as uncertainty: the commanded speed passes the nominal motor lag before
it is squared, and the vertical rows of thrust, signatures and bound pass through F. The impulse response of F is never
negative, hence |F xi| <= F xi_bar and every threshold keeps its guarantee. Drag acts on the velocity that is already
filtered.
"""

from __future__ import annotations

from dataclasses import dataclass

from casadi import fabs, if_else, sqrt, sum2, vertcat

from rotordx.fmus.diagnosers.interface import Clock, Command, Measured, critically_damped_filter, lagged_speed
from rotordx.fmus.model_terms.terms import fault_signatures, motor_lag, rate_dynamics
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

#: rad/s, where the remembered speed ends: nothing beside a rotor's speed, but no denormal numbers, which are slow
FORGOTTEN_SPEED = 1e-3


@ports
class ModelParameters:
    """Identified on healthy flights by `rotordx.gains.fdie`, save for the bandwidth, which is the sensors'."""

    velocity_filter_bandwidth: Scalar = port("rad/s", "w0 of the velocity filter (33)", start=20.0, minimum=1e-3)
    offset: Vector = port("m/s2, rad/s2", "xi_0 of (15): constant part of the known nonlinearity", start=(0,) * 4)
    bound_constant: Vector = port("m/s2, rad/s2", "xi_bar of (16): constant part", start=(0,) * 4, minimum=0)
    bound_slope: Vector = port("1", "xi_bar per acceleration by the rotors (less hover)", start=(0,) * 4, minimum=0)
    bound_transient_slope: Vector = port(
        "1", "xi_bar per difference that the motor lag makes to that acceleration", start=(0,) * 4, minimum=0
    )
    motor_lag_margin: Scalar = port(
        "1", "largest motor time constant over the nominal one, for what is remembered", start=1.15, minimum=1
    )


@ports
class ModelState:
    """Previous sample, lagged rotor speeds, and the filter F on ten vertical accelerations."""

    zeta: Vector = port("m/s, rad/s", "previous sample of v_z, p, q, r", start=(0,) * 4)
    rotor_speed: Vector = port("rad/s", "commanded speed after the nominal motor lag", start=(0,) * 4)
    remembered_speed: Vector = port("rad/s", "part of rotor_speed commanded before detection", start=(0,) * 4)
    vertical_filter: Vector = port("m/s2", "F applied to f, xi_bar, h_1..h_4, remembered h_1..h_4", start=(0,) * 10)
    vertical_filter_rate: Vector = port("m/s3", "time derivative of vertical_filter", start=(0,) * 10)


@dataclass(frozen=True)
class Model:
    """Means over the step that ends now; rows are the channels v_z, p, q, r, columns s the rotors."""

    zeta_rate: Vector  #: measured, (4,)
    nominal: Vector  #: f of (24), (4,)
    bound: Vector  #: xi_bar of (16), (4,)
    signatures: Vector  #: h_s of (25), (4, 4)
    remembered: Vector  #: largest part of h_s that the lags carry over from before detection, (4, 4)


def known_model(
    measured: Measured,
    command: Command,
    started: Scalar,
    detected: Scalar,
    state: ModelState,
    parameters: ModelParameters,
    vehicle: VehicleParameters,
    clock: Clock,
) -> tuple[ModelState, Model]:
    """Advance the model over one step.

    Args:
        started: 0 on the first sample, from which all filters start in steady state.
        detected: 1 if a fault was detected before this step.

    The means over the step are those of its two ends: held at the start of the step, f would be half a step late, an
    equivalent uncertainty of |df/dt| dt / 2. Euler angles are held between captures anyway.
    """
    dt = clock.dt
    zeta = vertcat(measured.vertical_velocity, measured.body_rate)
    zeta_before = if_else(started, state.zeta, zeta)
    mean_zeta = (zeta_before + zeta) / 2

    speed_before, speed = lagged_speed(started, state.rotor_speed, command, vehicle, dt)
    remembered_before = if_else(started, state.remembered_speed, command.rotor_speed_command)
    fading = motor_lag(remembered_before, FORGOTTEN_SPEED, dt / parameters.motor_lag_margin, vehicle)
    remembered_speed = if_else(detected, fading, speed)
    mean_speed = (speed_before + speed) / 2
    mean_remembered = (remembered_before + remembered_speed) / 2

    still = vertcat(0, mean_zeta[1:])
    nominal = rate_dynamics(still, measured.euler, mean_speed, vehicle) + parameters.offset
    signatures = fault_signatures(measured.euler, mean_speed, vehicle)
    # A loss that began before detection turns a rotor at alpha Omega + (1 - alpha) Omega_old, Omega_old <= the speed
    # remembered: the signature is short of full by at most loss h(sqrt(Omega Omega_remembered)).
    remembered = fault_signatures(measured.euler, sqrt(mean_speed * mean_remembered), vehicle)
    unlagged = fault_signatures(measured.euler, command.rotor_speed_command, vehicle)
    bound = _bound(signatures, unlagged, parameters, vehicle)

    target = vertcat(nominal[0], bound[0], signatures[0, :].T, remembered[0, :].T)
    before = if_else(started, state.vertical_filter, target)
    after, rate = critically_damped_filter(
        before, state.vertical_filter_rate, target, parameters.velocity_filter_bandwidth, dt
    )
    vertical = (before + after) / 2
    drag = -vehicle.drag_coefficient / vehicle.mass * mean_zeta[0]
    model = Model(
        zeta_rate=(zeta - zeta_before) / dt,
        nominal=vertcat(vertical[0] + drag, nominal[1:]),
        bound=vertcat(vertical[1], bound[1:]),
        signatures=vertcat(vertical[2:6].T, signatures[1:, :]),
        remembered=vertcat(vertical[6:10].T, remembered[1:, :]),
    )
    return ModelState(zeta, speed, remembered_speed, after, rate), model


def _bound(signatures: Vector, unlagged: Vector, parameters: ModelParameters, vehicle: VehicleParameters) -> Vector:
    """Bound on the uncertainty in the four channels: constant + slope |u| + transient slope |u_unlagged - u|."""
    acceleration = -sum2(signatures)  # G M Omega_bar of (17): all four rotors lost altogether, with the sign changed
    transient = -sum2(unlagged) - acceleration
    effort = acceleration + vertcat(vehicle.gravity, 0, 0, 0)
    return (
        parameters.bound_constant
        + parameters.bound_slope * fabs(effort)
        + parameters.bound_transient_slope * fabs(transient)
    )
