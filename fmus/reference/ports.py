"""Ports of the reference: which trajectory is flown and what the controller is told about it."""

from rotordx.fmus.shell.ports import Component, Scalar, Vector, port, ports

WAYPOINTS = 16
TRAJECTORIES = ("hover", "circle", "vertical_sine", "roll_sine", "ellipse", "waypoints")


@ports
class Inputs:
    """None: the trajectory is a function of time."""


@ports
class Parameters:
    """The trajectory; lengths and angles in the NED frame. The start values are the benchmark circle of paper 000."""

    trajectory: Scalar = port("1", "which trajectory is flown", 1, choices=TRAJECTORIES)
    start_time: Scalar = port("s", "the vehicle rests at the trajectory's first point before", minimum=0)
    ramp_time: Scalar = port("s", "time in which the motion gathers way, 0: at full rate from the start", minimum=0)
    centre: Vector = port("m", "hover point, or centre of circle and ellipse", (0, 0, -1.5))
    radius: Scalar = port("m", "radius of the circle, north semi-axis of the ellipse", 1.0, minimum=0)
    radius_y: Scalar = port("m", "east semi-axis of the ellipse", 0.6, minimum=0)
    angular_rate: Scalar = port("rad/s", "of circle, ellipse, vertical and roll sine", 0.8)
    vertical_amplitude: Scalar = port("m", "of the vertical sine: z = centre + amplitude sin", 0.3)
    roll_amplitude: Scalar = port("rad", "of the roll sine", 0.17453292519943295, minimum=-0.6, maximum=0.6)
    heading: Scalar = port("rad", "mean yaw angle; way-points have their own", 0.0)
    yaw_amplitude: Scalar = port("rad", "of the sinusoidal yaw on circle and ellipse", 0.5)
    yaw_period: Scalar = port("s", "of the sinusoidal yaw on circle and ellipse", 12.0, minimum=1e-3)
    waypoint_count: Scalar = port("1", "way-points in use", 4, minimum=1, maximum=WAYPOINTS)
    waypoint_x: Vector = port("m", "north", (0, 1, 1, 0) + (0,) * (WAYPOINTS - 4))
    waypoint_y: Vector = port("m", "east", (0, 0, 1, 1) + (0,) * (WAYPOINTS - 4))
    waypoint_z: Vector = port("m", "down", (-1.5,) * WAYPOINTS)
    waypoint_yaw: Vector = port("rad", "yaw angle, not wrapped: 2 pi more is a full turn", (0,) * WAYPOINTS)
    waypoint_hold: Scalar = port("s", "rest at every way-point", 1.0, minimum=0)
    speed_limit: Scalar = port("m/s", "largest speed between way-points", 1.0, minimum=1e-3)
    acceleration_limit: Scalar = port("m/s2", "largest acceleration between way-points", 2.0, minimum=1e-3)
    yaw_rate_limit: Scalar = port("rad/s", "largest yaw rate between way-points", 0.8, minimum=1e-3)


@ports
class Outputs:
    """Reference at the end of the step; velocity and acceleration are the exact derivatives of the position."""

    position_reference: Vector = port("m", "NED", (0, 0, 0))
    velocity_reference: Vector = port("m/s", "NED", (0, 0, 0))
    acceleration_reference: Vector = port("m/s2", "NED", (0, 0, 0))
    euler_reference: Vector = port("rad", "roll and pitch (of attitude mode, else 0), yaw", (0, 0, 0))
    yaw_rate_reference: Scalar = port("rad/s", "derivative of the yaw reference")
    attitude_mode: Scalar = port("1", "1: roll and pitch references are flown directly, altitude is held; else 0")


COMPONENT = Component("reference", "Trajectory to be flown", Inputs, Outputs, (Parameters,))
