"""What every diagnoser sees and says, and the symbolic steps that more than one of them is made of.

A diagnoser is a folder with a `step.py` that defines the port classes `Parameters`, `State` (start values = initial
state) and `Outputs` (a subclass of `DiagnosisOutputs`), and the function

    step(measured, command, state, parameters, vehicle, clock) -> (State, Outputs)

written on CasADi SX without branches. `measured` was sampled at `clock.time`; `command` is the rotor speed command
that acted during the step which ends there, (clock.time - clock.dt, clock.time]. Nothing else reaches a diagnoser.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import TypeVar

from casadi import DM, exp, expm1, fmax, if_else, mmax

from rotordx.fmus.model_terms.terms import motor_lag
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports, table
from rotordx.fmus.vehicles.parameters import VehicleParameters

T = TypeVar("T")

#: Rotors are numbered from 1.
ROTORS = DM([1, 2, 3, 4])


@ports
class Command:
    """What was sent to the speed controllers (after any accommodation)."""

    rotor_speed_command: Vector = port("rad/s", "rotor speeds commanded over the step that ends now", start=(0,) * 4)


@ports
class Measured:
    """What was measured at the end of the step."""

    euler: Vector = port("rad", "roll, pitch, yaw (3-2-1)", start=(0,) * 3)
    body_rate: Vector = port("rad/s", "p, q, r about the body axes (front, right, down)", start=(0,) * 3)
    vertical_velocity: Scalar = port("m/s", "velocity along inertial z, down positive")


@ports
class Inputs(Measured, Command):
    """Inputs of every diagnoser FMU: command first, then measurements (dataclass fields of the last base lead)."""


@ports
class Clock:
    """When the sample was taken."""

    time: Scalar = port("s", "time of the sample")
    dt: Scalar = port("s", "time since the previous sample (step_size)", start=0.002)


@ports
class DiagnosisOutputs:
    """What every diagnoser says; a subclass appends `residual`, `threshold` and the signals of its method."""

    fault_detected: Scalar = port("1", "1 once a fault has been detected (latched)")
    faulty_rotor: Scalar = port("1", "0 none named, 1..4 the rotor named (latched), -1 no loss of a single rotor")
    loe_estimate: Vector = port("1", "loss of effectiveness of the named rotor in its place, else 0", start=(0,) * 4)
    detection_time: Scalar = port("s", "time of detection, NaN before", start=nan)
    isolation_time: Scalar = port("s", "time at which a rotor was named, NaN before", start=nan)


def latch(held: Scalar, condition: Scalar) -> Scalar:
    """Flag (0 or 1, any shape) that is set by `condition` and never cleared."""
    return fmax(held, condition)


def capture_time(held: Scalar, before: Scalar, now: Scalar, time: Scalar) -> Scalar:
    """`time` of the first step at which a latched flag is set: `before` and `now` are its values around the step."""
    return if_else(now > before, time, held)


def select(condition: Scalar, if_true: T, if_false: T) -> T:
    """One of two instances of a port class, port by port."""
    ports_of = table(type(if_true))
    return type(if_true)(
        **{p.name: if_else(condition, getattr(if_true, p.name), getattr(if_false, p.name)) for p in ports_of}
    )


def any_of(conditions: Vector) -> Scalar:
    """1 if at least one element of a vector of flags is set."""
    return mmax(conditions)


def rows(values: Vector, columns: int) -> Vector:
    """The matrix that a parameter lists by rows."""
    return values.reshape((columns, values.numel() // columns)).T


def lagged_speed(
    started: Scalar, previous: Vector, command: Command, vehicle: VehicleParameters, dt: Scalar
) -> tuple[Vector, Vector]:
    """Rotor speeds (4), rad/s, at both ends of the step that ends now: the command behind the nominal motor lag.

    Args:
        started: 0 on the first sample, when it is as if the command had always been so.
        previous: the speeds at the start of the step (4), rad/s.
    """
    before = if_else(started, previous, command.rotor_speed_command)
    return before, motor_lag(before, command.rotor_speed_command, dt, vehicle)


def hold_filter(rate: Vector, dt: Scalar) -> tuple[Vector, Vector]:
    """(decay, gain) that advance x' = -rate x + u exactly over `dt` with u held: x+ = decay x + gain u, rate > 0."""
    gain = -expm1(-rate * dt) / rate
    return 1 - rate * gain, gain  # decay = exp(-rate dt), for one transcendental function instead of two


def critically_damped_filter(
    value: Vector, rate: Vector, target: Vector, bandwidth: Scalar, dt: Scalar
) -> tuple[Vector, Vector]:
    """(value, its time derivative) after `dt` of w0^2 / (s + w0)^2 driven by a held `target` (exact).

    This is the filter of Avram et al. (33) without its differentiator: unit gain, delay 2 / w0, and an impulse
    response that is never negative, so that a bound of the input filtered alike bounds the output.
    """
    error = value - target
    slope = rate + bandwidth * error
    decay = exp(-bandwidth * dt)
    return target + decay * (error + slope * dt), decay * (rate - bandwidth * slope * dt)


def runge_kutta(derivative: Callable[[Vector, float], Vector], start: Vector, dt: Scalar) -> Vector:
    """One step of the classical fourth-order method; derivative(value, share) after a share of the step."""
    first = derivative(start, 0.0)
    second = derivative(start + dt / 2 * first, 0.5)
    third = derivative(start + dt / 2 * second, 0.5)
    fourth = derivative(start + dt * third, 1.0)
    return start + dt / 6 * (first + 2 * second + 2 * third + fourth)
