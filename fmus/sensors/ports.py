"""Ports of the sensors: true motion in, gyro, motion capture and velocity estimate out."""

from rotordx.fmus.shell.ports import Component, Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import SensorParameters


@ports
class Inputs:
    """True motion at the end of the step."""

    true_position: Vector = port("m", "NED", (0, 0, 0))
    true_euler: Vector = port("rad", "roll, pitch, yaw", (0, 0, 0))
    true_body_rate: Vector = port("rad/s", "p, q, r", (0, 0, 0))


@ports
class Parameters:
    """Start of the velocity filter and of the noise."""

    initial_velocity: Vector = port("m/s", "NED, at the start: the velocity filter starts settled on it", (0, 0, 0))
    seed: Scalar = port("1", "of the noise, a whole number", 1, minimum=0, maximum=2**53)


@ports
class Outputs:
    """Measurements at the end of the step."""

    position: Vector = port("m", "motion capture, NED, held between captures", (0, 0, 0))
    euler: Vector = port("rad", "motion capture: roll, pitch, yaw, held between captures", (0, 0, 0))
    body_rate: Vector = port("rad/s", "gyro: p, q, r", (0, 0, 0))
    velocity: Vector = port("m/s", "filter (33) of paper 000 on the captured position, NED", (0, 0, 0))
    vertical_velocity: Scalar = port("m/s", "third element of velocity, down positive")


COMPONENT = Component(
    "sensors",
    "Gyro, motion capture and velocity filter",
    Inputs,
    Outputs,
    (SensorParameters, Parameters),
    initial_outputs_from_inputs=True,
)
