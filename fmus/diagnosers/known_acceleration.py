"""What is known to accelerate v_z, p, q, r over one step, matched to the motor lag and to the velocity filter.

The rotor speed lags its command, the measured vertical velocity lags the true one by the filter F = w0^2 / (s + w0)^2.
An observer must see neither lag as a fault: the commanded speed passes the nominal motor lag before it is squared, and
the vertical effect of each rotor passes through F. Drag acts on the velocity that is already filtered.
"""

from __future__ import annotations

from dataclasses import dataclass

from casadi import SX, if_else, sum2, vertcat

from rotordx.fmus.diagnosers.interface import Clock, Command, Measured, critically_damped_filter, lagged_speed
from rotordx.fmus.model_terms.terms import fault_signatures, rate_dynamics
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class KnownParameters:
    """What the sensors do to the vertical velocity."""

    velocity_filter_bandwidth: Scalar = port("rad/s", "w0 of the velocity filter", start=20.0, minimum=1e-3)


@ports
class KnownState:
    """Previous sample, lagged rotor speeds, and the filter F on the vertical effect of each rotor."""

    started: Scalar = port("1", "0 until the first sample")
    channels: Vector = port("m/s, rad/s", "previous sample of v_z, p, q, r", start=(0,) * 4)
    rotor_speed: Vector = port("rad/s", "commanded speed after the nominal motor lag", start=(0,) * 4)
    vertical_effect: Vector = port("m/s2", "F applied to what each rotor's loss does to v_z", start=(0,) * 4)
    vertical_effect_rate: Vector = port("m/s3", "time derivative of vertical_effect", start=(0,) * 4)


@dataclass(frozen=True)
class Known:
    """The step that ends now; channels are v_z, p, q, r, columns of the signatures the rotors."""

    before: Vector  #: measured channels at the start of the step (4,), m/s and rad/s
    after: Vector  #: measured channels at its end (4,)
    signatures: SX  #: what a total loss of each rotor adds to the channels' derivatives (4, 4), mean over the step
    euler: Vector  #: (3,), rad
    rotor_speed: Vector  #: mean over the step (4,), rad/s
    vertical_lag: Scalar  #: what F has not let through yet, m/s2
    vehicle: VehicleParameters

    def measured(self, share: float) -> Vector:
        """Channels (4) after a share of the step: linear between the samples, which is half as far off as held."""
        return self.before + share * (self.after - self.before)

    def acceleration(self, channels: Vector) -> Vector:
        """Acceleration (4) of a healthy vehicle at given channels: A x + B u + xi(x, u)."""
        unmatched = rate_dynamics(channels, self.euler, self.rotor_speed, self.vehicle)
        return unmatched + vertcat(self.vertical_lag, SX.zeros(3))


def known_acceleration(
    measured: Measured,
    command: Command,
    state: KnownState,
    parameters: KnownParameters,
    vehicle: VehicleParameters,
    clock: Clock,
) -> tuple[KnownState, Known]:
    """Advance lag and filter over one step; on the first sample everything is as if it had always been so.

    Means over the step are those of its two ends: held at either, the model would be half a step early or late.
    """
    channels = vertcat(measured.vertical_velocity, measured.body_rate)
    speed_before, speed = lagged_speed(state.started, state.rotor_speed, command, vehicle, clock.dt)
    mean_speed = (speed_before + speed) / 2

    unmatched = fault_signatures(measured.euler, mean_speed, vehicle)
    direct = unmatched[0, :].T
    effect_before = if_else(state.started, state.vertical_effect, direct)
    effect, effect_rate = critically_damped_filter(
        effect_before, state.vertical_effect_rate, direct, parameters.velocity_filter_bandwidth, clock.dt
    )
    filtered = ((effect_before + effect) / 2).T
    known = Known(
        before=if_else(state.started, state.channels, channels),
        after=channels,
        signatures=vertcat(filtered, unmatched[1:, :]),
        euler=measured.euler,
        rotor_speed=mean_speed,
        vertical_lag=sum2(unmatched[0, :] - filtered),  # thrust is what the loss of all rotors takes away
        vehicle=vehicle,
    )
    return KnownState(1, channels, speed, effect, effect_rate), known
