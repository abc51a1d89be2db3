"""Ports of the plant: rotor speeds in, motion of the rigid body out."""

from rotordx.fmus.shell.ports import Component, Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class Inputs:
    """What drives the body."""

    rotor_speed: Vector = port("rad/s", "at the end of the step", (0, 0, 0, 0), minimum=0)


@ports
class Parameters:
    """Initial state and disturbances, which are accelerations in the order x, y, z (NED), p, q, r (body)."""

    initial_position: Vector = port("m", "NED", (0, 0, 0))
    initial_velocity: Vector = port("m/s", "NED", (0, 0, 0))
    initial_euler: Vector = port("rad", "roll, pitch, yaw", (0, 0, 0))
    initial_body_rate: Vector = port("rad/s", "p, q, r", (0, 0, 0))
    gust_std: Vector = port("m/s2, rad/s2", "standard deviation before clipping", (0,) * 6, minimum=0)
    gust_time_constant: Vector = port("s", "correlation time", (1, 1, 1, 0.3, 0.3, 0.5), minimum=1e-3)
    gust_limit: Vector = port(
        "m/s2, rad/s2", "clipped to plus or minus this", (0.35, 0.35, 0.18, 0.7, 0.7, 0.09), minimum=0
    )
    constant_disturbance: Vector = port("m/s2, rad/s2", "added to the gusts", (0,) * 6)
    seed: Scalar = port("1", "of the gusts, a whole number", 1, minimum=0, maximum=2**53)


@ports
class Outputs:
    """Motion at the end of the step."""

    position: Vector = port("m", "NED", (0, 0, 0))
    velocity: Vector = port("m/s", "NED", (0, 0, 0))
    euler: Vector = port("rad", "roll, pitch, yaw (3-2-1)", (0, 0, 0))
    quaternion: Vector = port("1", "w, x, y, z; rotates body to NED", (1, 0, 0, 0))
    body_rate: Vector = port("rad/s", "p, q, r", (0, 0, 0))
    specific_force: Vector = port("m/s2", "body: acceleration without gravity", (0, 0, 0))
    disturbance: Vector = port(
        "m/s2, rad/s2", "gust and constant over the step: x, y, z (NED), p, q, r (body)", (0,) * 6
    )


COMPONENT = Component(
    "plant",
    "Quadrotor rigid body in gusts",
    Inputs,
    Outputs,
    (VehicleParameters, Parameters),
    initial_outputs_from_inputs=True,
)
