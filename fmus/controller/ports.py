"""Ports of the controller: references and measurements in, rotor speed commands out."""

from rotordx.fmus.reference.ports import Outputs as ReferenceOutputs
from rotordx.fmus.shell.ports import Component, Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.fmus.vehicles.vehicle import POSITIVE


@ports
class Inputs(ReferenceOutputs):
    """The outputs of the reference, then what the sensors measure."""

    position: Vector = port("m", "motion capture, NED", (0, 0, 0))
    velocity: Vector = port("m/s", "filtered derivative of the captured position, NED", (0, 0, 0))
    euler: Vector = port("rad", "motion capture: roll, pitch, yaw", (0, 0, 0))
    body_rate: Vector = port("rad/s", "gyro: p, q, r", (0, 0, 0))


@ports
class Parameters:
    """Gains per unit of acceleration, so that they carry over between vehicles."""

    position_gain: Vector = port("1/s2", "x, y, z: acceleration per position error", (2.2, 2.2, 6.0), minimum=0)
    velocity_gain: Vector = port("1/s", "x, y, z: acceleration per velocity error", (2.4, 2.4, 4.5), minimum=0)
    position_integral_gain: Vector = port("1/s3", "x, y, z: per integral of position error", (0.5, 0.5, 2.5), minimum=0)
    position_integral_limit: Vector = port("m/s2", "x, y, z: largest integral action", (1.0, 1.0, 4.0), minimum=0)
    velocity_filter_bandwidth: Scalar = port(
        "rad/s", "omega_0 of filter (33) in the sensors, whose delay is allowed for", 20.0, minimum=POSITIVE
    )
    vertical_acceleration_limit: Scalar = port("m/s2", "largest demand of the altitude loop", 6.0, minimum=0)
    tilt_limit: Scalar = port("rad", "largest roll and pitch demand of the outer loop", 0.35, minimum=0, maximum=1.0)
    attitude_gain: Vector = port("1/s", "roll, pitch, yaw: rate per angle error", (6.0, 6.0, 2.5), minimum=0)
    rate_gain: Vector = port("1/s", "p, q, r: angular acceleration per rate error", (16.0, 16.0, 6.0), minimum=0)
    rate_integral_gain: Vector = port("1/s2", "p, q, r: per integral of rate error", (44.0, 44.0, 8.0), minimum=0)
    rate_integral_limit: Vector = port("rad/s2", "p, q, r: largest integral action", (30.0, 30.0, 8.0), minimum=0)
    motor_lag_lead: Scalar = port(
        "1", "lead of the torque demand: the motor lag seems shorter by this factor", 1.5, minimum=1, maximum=5
    )
    gyro_filter_bandwidth: Scalar = port("rad/s", "first-order low pass on the gyro", 220.0, minimum=POSITIVE)


@ports
class Outputs:
    """Commands from the sample at the start of the step, held over the step."""

    rotor_speed_command: Vector = port("rad/s", "within the rotor speed limits", (0, 0, 0, 0))
    thrust_command: Scalar = port("N", "demand of the altitude loop before saturation")
    torque_command: Vector = port("N.m", "body axes, demand of the rate loop before saturation", (0, 0, 0))
    euler_command: Vector = port("rad", "roll, pitch, yaw demanded of the attitude loop", (0, 0, 0))


COMPONENT = Component(
    "controller", "Double-loop trajectory controller", Inputs, Outputs, (VehicleParameters, Parameters)
)
