"""Ports that a vehicle fills in: its physical parameters and those of its sensors.

The start values are those of the benchmark vehicle `lab_x`, so that an FMU flies it unless it is told otherwise.
"""

from __future__ import annotations

from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.vehicle import POSITIVE, packaged, read_file

#: Its values are the start values of every FMU.
REFERENCE_VEHICLE = "lab_x"

_LAB_X = read_file(packaged(REFERENCE_VEHICLE)).parameters


@ports
class VehicleParameters:
    """Physics of one quadrotor; frames are body FRD and inertial NED, rotor arrays are in the order of the rotors."""

    mass: Scalar = port("kg", "mass m", _LAB_X["mass"], minimum=POSITIVE)
    inertia: Vector = port("kg.m2", "moments of inertia about body x, y, z", _LAB_X["inertia"], minimum=POSITIVE)
    rotor_x: Vector = port("m", "rotor positions forward of the geometric centre", _LAB_X["rotor_x"])
    rotor_y: Vector = port("m", "rotor positions right of the geometric centre", _LAB_X["rotor_y"])
    centre_of_mass: Vector = port("m", "centre of mass from the geometric centre, x and y", _LAB_X["centre_of_mass"])
    rotor_direction: Vector = port(
        "1",
        "+1: turns counter-clockwise seen from above, its reaction torque on the body is +yaw; -1: the opposite",
        _LAB_X["rotor_direction"],
        minimum=-1,
        maximum=1,
    )
    thrust_coefficient: Vector = port(
        "N.s2", "thrust over squared rotor speed b_F", _LAB_X["thrust_coefficient"], minimum=POSITIVE
    )
    torque_coefficient: Vector = port(
        "N.m.s2", "reaction torque over squared rotor speed k", _LAB_X["torque_coefficient"], minimum=POSITIVE
    )
    drag_coefficient: Scalar = port("N.s/m", "drag force over velocity c_d", _LAB_X["drag_coefficient"], minimum=0)
    rotor_inertia: Scalar = port(
        "kg.m2", "moment of inertia of a rotor about its axis J_r", _LAB_X["rotor_inertia"], minimum=0
    )
    motor_time_constant: Scalar = port(
        "s", "time constant of the rotor speed's first-order lag", _LAB_X["motor_time_constant"], minimum=POSITIVE
    )
    rotor_speed_min: Scalar = port("rad/s", "smallest rotor speed", _LAB_X["rotor_speed_min"], minimum=0)
    rotor_speed_max: Scalar = port("rad/s", "largest rotor speed", _LAB_X["rotor_speed_max"], minimum=POSITIVE)
    gravity: Scalar = port("m/s2", "acceleration of gravity g", _LAB_X["gravity"], minimum=0)


@ports
class SensorParameters:
    """Errors and rates of the gyro and of the motion capture system."""

    gyro_noise_std: Scalar = port(
        "rad/s", "standard deviation of one gyro sample's noise", _LAB_X["gyro_noise_std"], minimum=0
    )
    gyro_bias: Vector = port("rad/s", "constant error of the gyro about body x, y, z", _LAB_X["gyro_bias"])
    motion_capture_position_noise_std: Scalar = port(
        "m", "standard deviation of a captured position", _LAB_X["motion_capture_position_noise_std"], minimum=0
    )
    motion_capture_attitude_noise_std: Scalar = port(
        "rad", "standard deviation of a captured Euler angle", _LAB_X["motion_capture_attitude_noise_std"], minimum=0
    )
    motion_capture_period: Scalar = port(
        "s", "time between two captures", _LAB_X["motion_capture_period"], minimum=POSITIVE
    )
    motion_capture_latency: Scalar = port(
        "s", "delay from capture to delivery", _LAB_X["motion_capture_latency"], minimum=0
    )
    velocity_filter_bandwidth: Scalar = port(
        "rad/s", "bandwidth omega_0 of the velocity filter (33)", _LAB_X["velocity_filter_bandwidth"], minimum=POSITIVE
    )
