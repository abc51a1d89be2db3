"""Quadrotor dynamics from paper 000's equations (1)-(5), (10), (11) and balances of momentum, in plain numpy.

Derived without `terms.py`: attitude is Euler angles, forces act at points, and the rotation is the balance of angular
momentum in inertial axes, whose time derivatives are complex steps (exact to rounding), not a formula with omega x.
"""

import numpy as np

COMPLEX_STEP = 1e-30


def rotation(euler):
    """R_EB as printed in (5)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(euler), np.sin(euler)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


def euler_rate(euler, body_rate):
    """(3) with R_eta as printed below (5)."""
    roll, pitch, _ = euler
    matrix = np.array(
        [
            [1, np.sin(roll) * np.tan(pitch), np.cos(roll) * np.tan(pitch)],
            [0, np.cos(roll), -np.sin(roll)],
            [0, np.sin(roll) / np.cos(pitch), np.cos(roll) / np.cos(pitch)],
        ]
    )
    return matrix @ body_rate


def rotation_rate(euler, body_rate):
    """Time derivative of R_EB along (3)."""
    return rotation(euler + 1j * COMPLEX_STEP * euler_rate(euler, body_rate)).imag / COMPLEX_STEP


def wrench(rotor_speed, vehicle):
    """Total thrust and torque about the centre of mass: each rotor's force at its place, and its reaction."""
    total, torque = 0.0, np.zeros(3)
    for rotor in range(4):
        force = vehicle.thrust_coefficient[rotor] * rotor_speed[rotor] ** 2
        arm = np.array([vehicle.rotor_x[rotor], vehicle.rotor_y[rotor], 0]) - [*vehicle.centre_of_mass, 0]
        # the air turns a counter-clockwise rotor, and the body with it, clockwise: positive about z, which points down
        reaction = vehicle.rotor_direction[rotor] * vehicle.torque_coefficient[rotor] * rotor_speed[rotor] ** 2
        total += force
        torque += np.cross(arm, np.array([0, 0, -force])) + np.array([0, 0, reaction])
    return total, torque


def acceleration(velocity, euler, rotor_speed, vehicle):
    """(2): thrust, drag along the velocity in body axes, gravity."""
    matrix = rotation(euler)
    thrust, _ = wrench(rotor_speed, vehicle)
    body_velocity = matrix.T @ velocity
    force = np.array([0, 0, -thrust]) - vehicle.drag_coefficient * body_velocity
    return matrix @ force / vehicle.mass + [0, 0, vehicle.gravity]


def angular_acceleration(euler, body_rate, rotor_speed, vehicle):
    """Balance of angular momentum of body and rotors: d/dt (R (J omega + h)) = R torque, at constant rotor speeds."""
    matrix, matrix_rate = rotation(euler), rotation_rate(euler, body_rate)
    counter_clockwise = np.array([0, 0, -1])  # seen from above: right-handed about the upward axis
    spin = sum(vehicle.rotor_direction[i] * rotor_speed[i] for i in range(4)) * counter_clockwise
    momentum = vehicle.inertia * body_rate + vehicle.rotor_inertia * spin
    _, torque = wrench(rotor_speed, vehicle)
    return matrix.T @ (matrix @ torque - matrix_rate @ momentum) / vehicle.inertia


def rotation_by_quaternion(quaternion):
    """Matrix whose columns are the body's axes e turned as q e q*, of any quaternion of norm 1 (also complex)."""
    w, v = quaternion[0], quaternion[1:]
    return np.column_stack([e * (w * w - v @ v) + 2 * v * (v @ e) + 2 * w * np.cross(v, e) for e in np.eye(3)])
