"""The observer of state and faults (Ren 2020, (24) corrected): attitude, body rates, v_z, and what is lost.

    x_hat' = A x_hat + f(x_hat) + B (tau + f_hat) + L (y - C x_hat),    f_hat' = K (y - C x_hat)

with [L; K] one gain. Two models share these equations. `vz4` has four rotor faults and x = [roll, pitch, yaw, p, q, r,
v_z], with the velocity filter (33) of paper 000 behind v_z; its faults are losses of effectiveness with a minus sign,
so that f_a of the paper is the fault times the squared rotor speed. `tau3` knows nothing of v_z and has three torque
faults, in units of the largest torque that the total loss of one rotor takes away in hover.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from casadi import SX, diag, fabs, fmax, if_else, mmax, vertcat

from rotordx.fmus.diagnosers.attitude_observer import Interval, ObserverState, StateEstimate, interval, observer_state
from rotordx.fmus.diagnosers.interface import Command, Measured, rows, runge_kutta
from rotordx.fmus.model_terms.terms import euler_rate, fault_signatures, rate_dynamics
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

#: of the hover speed: below it a rotor's loss is found the slower
SLOWEST = 0.25

#: The models, in the order of the parameter's values.
MODELS = ("vz4", "tau3")


@ports
class GainParameters:
    """Designed and proved by gains/hinf.py."""

    fault_model: Scalar = port(
        "1", "vz4: four independent rotor faults; tau3: three torque faults, v_z is not used", choices=MODELS
    )
    observer_gain: Vector = port(
        "1/s",
        "[L; K] of vz4, 13x7 by rows: roll, pitch, yaw, p, q, r, filtered v_z, lag, v_z, faults (4)",
        start=(0,) * 91,
    )
    torque_observer_gain: Vector = port(
        "1/s", "[L; K] of tau3, 9x6 by rows: roll, pitch, yaw, p, q, r, torque faults (3)", start=(0,) * 54
    )
    hover_speed: Vector = port("rad/s", "rotor speeds in hover, the units of the faults", (500,) * 4, minimum=1e-3)
    velocity_filter_bandwidth: Scalar = port("rad/s", "w0 of the velocity filter (33)", start=20.0, minimum=1e-3)


@ports
class FaultObserverState(ObserverState):
    """Attitude and rates, then the vertical part and the faults."""

    vertical_velocity: Scalar = port("m/s", "previous measurement")
    vertical: Vector = port("m/s, m", "estimated v_z behind the filter, lag of the filter, v_z", start=(0,) * 3)
    fault: Vector = port("1", "f_hat: faults of the rotors (4), or of the torques (3) and 0", start=(0,) * 4)


@ports
class FaultObserverOutputs(StateEstimate):
    """Estimated state and faults."""

    vertical_velocity_estimate: Scalar = port("m/s", "estimated v_z without the filter's delay, NaN with tau3")
    fault_estimate: Vector = port(
        "1", "f_hat: missing part of each rotor's squared speed over hover's; with tau3 of the torques, and 0", (0,) * 4
    )
    acceleration_fault: Vector = port("m/s2, rad/s2", "what f_hat does to v_z (0 with tau3), p, q, r", start=(0,) * 4)
    torque_fault: Vector = port("N.m", "what f_hat does to the torques", start=(0,) * 3)


@dataclass(frozen=True)
class Estimate:
    """The observer after a step."""

    state: FaultObserverState
    outputs: FaultObserverOutputs
    rotor_speed: Vector  #: rad/s, mean over the step, nominal
    signatures: Vector  #: columns h_s (4, 4), what a total loss of each rotor adds to v_z, p, q, r now


def advance_observer(
    measured: Measured,
    command: Command,
    state: FaultObserverState,
    parameters: GainParameters,
    vehicle: VehicleParameters,
    dt: Scalar,
) -> Estimate:
    """Advance over the step that ends now; on the first sample state and measurement agree, and no fault is known."""
    known = interval(measured, command, state, vehicle, dt)
    sees_vertical = parameters.fault_model == MODELS.index("vz4")
    velocity_before = if_else(state.started, state.vertical_velocity, measured.vertical_velocity)
    gain = if_else(sees_vertical, rows(parameters.observer_gain, 7), _embedded(parameters.torque_observer_gain))

    def derivative(z: Vector, share: float) -> Vector:
        y = known.measured(share)
        v_z = velocity_before + share * (measured.vertical_velocity - velocity_before)
        euler, body_rate, vertical, fault = y[:3], z[3:6], z[6:9], z[9:13]
        # The attitude is measured: with it, not with its estimate, the only nonlinearity of the error is in the rates.
        healthy = rate_dynamics(vertcat(0, body_rate), euler, known.rotor_speed(share), vehicle)
        effort = fault_effort(known.rotor_speed(share), sees_vertical, parameters)
        acceleration = healthy + fault_input(euler, sees_vertical, parameters, vehicle) @ (effort * fault)
        model = vertcat(
            euler_rate(euler, body_rate),
            acceleration[1:],
            sees_vertical * _vertical_rate(vertical, acceleration[0], parameters.velocity_filter_bandwidth, vehicle),
            SX.zeros(4),
        )
        injection = gain @ (vertcat(y, v_z) - z[:7])
        return model + vertcat(injection[:9], injection[9:] / effort)

    lag = 2 / parameters.velocity_filter_bandwidth * measured.vertical_velocity  # of uniform motion
    uniform = vertcat(measured.vertical_velocity, lag, measured.vertical_velocity)
    start = vertcat(known.estimate, if_else(state.started, state.vertical, uniform), state.fault)
    z = if_else(state.started, runge_kutta(derivative, start, dt), start)
    return _estimate(z, known, measured, sees_vertical, parameters, vehicle)


def fault_effort(rotor_speed: Vector, sees_vertical: Scalar, parameters: GainParameters) -> Vector:
    """Squared rotor speeds (4) over those in hover, 1 with tau3: the faults' weights in B.

    A loss of effectiveness stays the same while the controller answers to it; the missing squared speed, the paper's
    f_a, does not. So the losses are the state, and K over the effort keeps B K, and so the loop, as it is proved.
    """
    effort = fmax(rotor_speed / parameters.hover_speed, SLOWEST) ** 2
    return if_else(sees_vertical, effort, 1)


def fault_input(euler: Vector, sees_vertical: Scalar, parameters: GainParameters, vehicle: VehicleParameters) -> Vector:
    """B (4, 4): accelerations of v_z, p, q, r by unit faults."""
    hover = fault_signatures(euler, parameters.hover_speed, vehicle)
    largest = vertcat(*(mmax(fabs(hover[axis, :].T)) for axis in (1, 2, 3)))
    torques = vertcat(SX.zeros(1, 4), diag(vertcat(largest, 0))[:3, :])
    return if_else(sees_vertical, -hover, torques)


def _vertical_rate(vertical: Vector, acceleration: Scalar, bandwidth: Scalar, vehicle: VehicleParameters) -> Vector:
    """Time derivative (3) of v_z behind the filter, the filter's lag, and v_z."""
    filtered, lag, v_z = vertical[0], vertical[1], vertical[2]
    drag = -vehicle.drag_coefficient / vehicle.mass * v_z
    return vertcat(bandwidth**2 * lag - 2 * bandwidth * filtered, v_z - filtered, acceleration + drag)


def _estimate(
    z: Vector,
    known: Interval,
    measured: Measured,
    sees_vertical: Scalar,
    parameters: GainParameters,
    vehicle: VehicleParameters,
) -> Estimate:
    observer, vertical, fault = observer_state(z[:6], known), z[6:9], z[9:13]
    missing = fault_effort(known.speed, sees_vertical, parameters) * fault
    acceleration = fault_input(measured.euler, sees_vertical, parameters, vehicle) @ missing
    outputs = FaultObserverOutputs(
        euler_estimate=observer.euler_estimate,
        body_rate_estimate=observer.body_rate_estimate,
        vertical_velocity_estimate=if_else(sees_vertical, vertical[2], nan),
        fault_estimate=missing,
        acceleration_fault=acceleration,
        torque_fault=vehicle.inertia * acceleration[1:],
    )
    after = FaultObserverState(
        **vars(observer), vertical_velocity=measured.vertical_velocity, vertical=vertical, fault=fault
    )
    speed = known.rotor_speed(0.5)
    return Estimate(after, outputs, speed, fault_signatures(measured.euler, speed, vehicle))


def _embedded(torque_observer_gain: Vector) -> Vector:
    """The gain of tau3 (9x6) in the places that its states have among those of vz4 (13x7)."""
    gain = rows(torque_observer_gain, 6)
    whole = SX.zeros(13, 7)
    whole[:6, :6], whole[9:12, :6] = gain[:6, :], gain[6:, :]
    return whole
