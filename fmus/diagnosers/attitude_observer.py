"""Observers of attitude and body rates, y = x = [roll, pitch, yaw, p, q, r], in discrete time: what they share.

    x_hat' = A x_hat + p(x_hat, u) + B u + w

A x + p + B u is the rigid body of the model terms, u its known torques; w is what a diagnoser adds: its injection of
y_hat - y, its fault estimate, its sliding term.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from casadi import SX, floor, if_else, vertcat

from rotordx.fmus.diagnosers.interface import Command, DiagnosisOutputs, Measured, lagged_speed
from rotordx.fmus.model_terms.terms import euler_rate, fault_signatures, rate_dynamics
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class ObserverState:
    """Estimated state, and the previous sample of what drives the observer."""

    started: Scalar = port("1", "0 until the first sample")
    euler_estimate: Vector = port("rad", "x_hat: roll, pitch, yaw, within +-pi", start=(0,) * 3)
    body_rate_estimate: Vector = port("rad/s", "x_hat: p, q, r", start=(0,) * 3)
    euler: Vector = port("rad", "previous measurement", start=(0,) * 3)
    body_rate: Vector = port("rad/s", "previous measurement", start=(0,) * 3)
    rotor_speed: Vector = port("rad/s", "commanded speed after the nominal motor lag", start=(0,) * 4)


@ports
class StateEstimate:
    """The state, as an output."""

    euler_estimate: Vector = port("rad", "x_hat: roll, pitch, yaw, within +-pi", start=(0,) * 3)
    body_rate_estimate: Vector = port("rad/s", "x_hat: p, q, r", start=(0,) * 3)


@ports
class ObserverOutputs(StateEstimate):
    """State and fault."""

    torque_fault: Vector = port("N.m", "f_hat: torque about x, y, z beyond the healthy rotors'", start=(0,) * 3)
    acceleration_fault: Vector = port(
        "m/s2, rad/s2", "unknown acceleration of v_z (always 0), p, q, r: torque_fault over inertia", start=(0,) * 4
    )
    motor_offset: Vector = port("N", "thrust that the named rotor lacks in its place, else 0", start=(0,) * 4)
    isolation_model: Scalar = port("1", "1: one rotor's loss is assumed", start=1)


@dataclass(frozen=True)
class Interval:
    """What is known over the step that ends now: at its two ends, and linear in between.

    Held at either end, it would be half a step early or late: at 95 rad/s2, which 30 % of a rotor are to the F450,
    the rate would be off by 0.1 rad/s, and K times that looks like a fault of a tenth of the real one.
    """

    estimate: Vector  #: x_hat at the start, (6,)
    measurement_before: Vector  #: y at the start, (6,)
    measurement: Vector  #: y at the end, (6,)
    speed_before: Vector  #: rotor speeds at the start, (4,) rad/s
    speed: Vector  #: rotor speeds at the end, (4,) rad/s

    def measured(self, share: float) -> Vector:
        """Measurement after a share of the step, (6,)."""
        return self.measurement_before + share * (self.measurement - self.measurement_before)

    def rotor_speed(self, share: float) -> Vector:
        """Rotor speeds after a share of the step, (4,) rad/s."""
        return self.speed_before + share * (self.speed - self.speed_before)


def interval(
    measured: Measured, command: Command, state: ObserverState, vehicle: VehicleParameters, dt: Scalar
) -> Interval:
    """The step that ends at this sample; on the first sample everything is as if it had always been so.

    Angles are continued from the estimate: a measured yaw that jumps from pi to -pi is no error of 2 pi.
    """
    measurement = vertcat(measured.euler, measured.body_rate)
    estimate = if_else(state.started, vertcat(state.euler_estimate, state.body_rate_estimate), measurement)
    before = if_else(state.started, vertcat(state.euler, state.body_rate), measurement)
    speed_before, speed = lagged_speed(state.started, state.rotor_speed, command, vehicle, dt)
    return Interval(
        estimate=estimate,
        measurement_before=continued(estimate, before),
        measurement=continued(estimate, measurement),
        speed_before=speed_before,
        speed=speed,
    )


def model(estimate: Vector, rotor_speed: Vector, vehicle: VehicleParameters) -> Vector:
    """A x_hat + p(x_hat, u) + B u for healthy rotors: rates of the Euler angles and body rates (6)."""
    euler, body_rate = estimate[:3], estimate[3:6]
    acceleration = rate_dynamics(vertcat(0, body_rate), euler, rotor_speed, vehicle)[1:]
    return vertcat(euler_rate(euler, body_rate), acceleration)


def observer_state(estimate: Vector, known: Interval) -> ObserverState:
    """The observer's state after a step that led to x_hat (6)."""
    euler, measured_euler = wrapped(estimate[:3]), wrapped(known.measurement[:3])
    return ObserverState(1, euler, estimate[3:6], measured_euler, known.measurement[3:6], known.speed)


def observer_outputs(
    state: ObserverState, fault: Vector, verdict: DiagnosisOutputs, known: Interval, vehicle: VehicleParameters
) -> ObserverOutputs:
    """x_hat, and the fault as acceleration (4, that of v_z is 0), as torque, as thrust.

    Three torques do not give four thrusts: the thrust follows from the verdict, which assumes one faulty rotor.
    """
    healthy_thrust = vehicle.thrust_coefficient * known.rotor_speed(0.5) ** 2
    return ObserverOutputs(
        euler_estimate=state.euler_estimate,
        body_rate_estimate=state.body_rate_estimate,
        torque_fault=vehicle.inertia * fault[1:],
        acceleration_fault=fault,
        motor_offset=-verdict.loe_estimate * healthy_thrust,
        isolation_model=1,
    )


def torque_signatures(known: Interval, vehicle: VehicleParameters) -> SX:
    """Columns h_s (4, 4): what a total loss of each rotor adds to p, q, r, rad/s2; v_z is not looked at."""
    signatures = fault_signatures(known.measurement[:3], known.rotor_speed(0.5), vehicle)
    return vertcat(SX.zeros(1, 4), signatures[1:, :])


def wrapped(angle: Vector) -> Vector:
    """The same angles within [-pi, pi)."""
    return angle - 2 * pi * floor((angle + pi) / (2 * pi))


def continued(estimate: Vector, measurement: Vector) -> Vector:
    """A measurement (6) with whole turns added to its angles so that they come next to the estimate's."""
    return vertcat(estimate[:3] + wrapped(measurement[:3] - estimate[:3]), measurement[3:])
