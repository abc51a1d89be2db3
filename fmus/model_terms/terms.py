"""Equations of motion of a quadrotor and what its diagnosers need of them, symbolic.

Arguments are CasADi SX columns in SI units, `vehicle` is a `VehicleParameters` of symbols or numbers. Frames are NED
and FRD, Euler angles roll, pitch, yaw (3-2-1). Equation numbers are those of paper 000 (Avram, Zhang, Khalili); the
README beside this file lists the equations and where they deviate from the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from casadi import (
    SX,
    asin,
    atan2,
    cos,
    cross,
    diag,
    exp,
    fmax,
    fmin,
    horzcat,
    jacobian,
    sin,
    substitute,
    sum1,
    tan,
    vertcat,
    vertsplit,
)

from rotordx.fmus.model_terms.allocation import allocation_rows


def allocation(vehicle: Any) -> SX:
    """M (4x4) of [U; tau_x; tau_y; tau_z] = M Omega^2, (10) and (11) for any geometry and centre of mass."""
    return vertcat(*(horzcat(*row) for row in allocation_rows(vehicle)))


def motor_lag(rotor_speed: SX, target_speed: SX, dt: SX, vehicle: Any) -> SX:
    """Rotor speeds (4) after dt of tau dOmega/dt = target - Omega with the target held (exact)."""
    return target_speed + exp(-dt / vehicle.motor_time_constant) * (rotor_speed - target_speed)


# Attitude


def rotation_matrix(euler: SX) -> SX:
    """R_EB (3x3) of (5): body to NED components."""
    roll, pitch, yaw = vertsplit(euler)
    about_x = vertcat(horzcat(1, 0, 0), horzcat(0, cos(roll), -sin(roll)), horzcat(0, sin(roll), cos(roll)))
    about_y = vertcat(horzcat(cos(pitch), 0, sin(pitch)), horzcat(0, 1, 0), horzcat(-sin(pitch), 0, cos(pitch)))
    about_z = vertcat(horzcat(cos(yaw), -sin(yaw), 0), horzcat(sin(yaw), cos(yaw), 0), horzcat(0, 0, 1))
    return about_z @ about_y @ about_x


def euler_rate(euler: SX, body_rate: SX) -> SX:
    """Time derivative (3) of the Euler angles, R_eta omega of (3); singular at a pitch of 90 degrees."""
    roll, pitch, _ = vertsplit(euler)
    p, q, r = vertsplit(body_rate)
    turning = sin(roll) * q + cos(roll) * r
    return vertcat(p + turning * tan(pitch), cos(roll) * q - sin(roll) * r, turning / cos(pitch))


def quaternion_from_euler(euler: SX) -> SX:
    """Unit quaternion (w, x, y, z), body to NED."""
    (cr, cp, cy), (sr, sp, sy) = vertsplit(cos(euler / 2)), vertsplit(sin(euler / 2))
    return vertcat(
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_quaternion(quaternion: SX) -> SX:
    """Euler angles (3) of a unit quaternion: roll and yaw within +-pi, pitch within +-pi/2."""
    w, x, y, z = vertsplit(quaternion)
    sine_of_pitch = fmax(-1, fmin(1, 2 * (w * y - z * x)))  # rounding must not carry it out of asin's domain
    return vertcat(
        atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        asin(sine_of_pitch),
        atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )


def rotation_matrix_from_quaternion(quaternion: SX) -> SX:
    """R_EB (3x3) of a unit quaternion (w, x, y, z)."""
    w, x, y, z = vertsplit(quaternion)
    return vertcat(
        horzcat(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        horzcat(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        horzcat(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def quaternion_rate(quaternion: SX, body_rate: SX) -> SX:
    """Time derivative (4) of the quaternion, half of quaternion * (0, body_rate); it keeps the norm."""
    w, x, y, z = vertsplit(quaternion)
    p, q, r = vertsplit(body_rate / 2)
    return vertcat(-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p)


# Rigid body: state = position (3, NED), velocity (3, NED), quaternion (4, body to NED), body_rate (3);
# disturbance = acceleration (3, NED) and angular acceleration (3, body), xi_v and xi_omega of (2) and (4).


def coupling_torque(body_rate: SX, rotor_speed: SX, vehicle: Any) -> SX:
    """Torque (3) by turning what spins, -omega x momentum: first term of (4) and, as xi_0, rotor gyroscopics.

    The body has the angular momentum J omega, the rotors -J_r sum(direction Omega) about z: a rotor turning
    counter-clockwise (direction +1) has it upwards.
    """
    rotor_momentum = -vehicle.rotor_inertia * sum1(vehicle.rotor_direction * rotor_speed)
    return -cross(body_rate, vehicle.inertia * body_rate + vertcat(0, 0, rotor_momentum))


def rigid_body_derivative(state: SX, rotor_speed: SX, disturbance: SX, vehicle: Any) -> SX:
    """Time derivative (13) of the state, (1)-(4) with quaternion attitude."""
    _, velocity, quaternion, body_rate = vertsplit(state, [0, 3, 6, 10, 13])
    wrench = allocation(vehicle) @ rotor_speed**2
    down = rotation_matrix_from_quaternion(quaternion)[:, 2]  # body z in NED components, thrust acts against it
    drag = vehicle.drag_coefficient / vehicle.mass * velocity  # R_EB v_B = v_E: isotropic drag (2) acts in NED
    torque = wrench[1:] + coupling_torque(body_rate, rotor_speed, vehicle)
    return vertcat(
        velocity,
        vertcat(0, 0, vehicle.gravity) - wrench[0] / vehicle.mass * down - drag + disturbance[:3],
        quaternion_rate(quaternion, body_rate),
        torque / vehicle.inertia + disturbance[3:],
    )


def specific_force(state: SX, rotor_speed: SX, disturbance: SX, vehicle: Any) -> SX:
    """What an ideal accelerometer at the centre of mass reads (3, body): acceleration without gravity."""
    _, velocity, quaternion, _ = vertsplit(state, [0, 3, 6, 10, 13])
    thrust = allocation(vehicle)[0, :] @ rotor_speed**2
    without_thrust = disturbance[:3] - vehicle.drag_coefficient / vehicle.mass * velocity
    return rotation_matrix_from_quaternion(quaternion).T @ without_thrust - vertcat(0, 0, thrust / vehicle.mass)


# Rate dynamics of (14): zeta = [v_z, p, q, r], d zeta/dt = f(zeta, Omega) + xi + sum_s theta_s h_s.


def input_gain(euler: SX, vehicle: Any) -> SX:
    """G (4x4) of (14): accelerations zeta by thrust and torques."""
    return diag(vertcat(-cos(euler[0]) * cos(euler[1]) / vehicle.mass, 1 / vehicle.inertia))


def rate_dynamics(zeta: SX, euler: SX, rotor_speed: SX, vehicle: Any) -> SX:
    """f (4) of (24) for healthy rotors: phi, (15) corrected, plus G M Omega^2."""
    phi = vertcat(
        vehicle.gravity - vehicle.drag_coefficient / vehicle.mass * zeta[0],
        coupling_torque(zeta[1:], rotor_speed, vehicle) / vehicle.inertia,
    )
    return phi + input_gain(euler, vehicle) @ (allocation(vehicle) @ rotor_speed**2)


def fault_signatures(euler: SX, rotor_speed: SX, vehicle: Any) -> SX:
    """[h_1 h_2 h_3 h_4] (4x4) of (25): what a total loss of effectiveness of each rotor adds to d zeta/dt."""
    return -input_gain(euler, vehicle) @ allocation(vehicle) @ diag(rotor_speed**2)


def jacobians(term: Callable[..., SX], arguments: Sequence[SX], vehicle: Any) -> list[SX]:
    """Derivatives of a column term(*arguments, vehicle) with respect to each argument, at any expressions.

    Args:
        term: a function of this module such as `rate_dynamics`.
        arguments: its arguments but the vehicle, columns.
        vehicle: `VehicleParameters` of symbols or numbers.

    Returns:
        for each argument a matrix of as many rows as the term and as many columns as the argument.
    """
    variables = [SX.sym(f"argument_{i}", argument.shape) for i, argument in enumerate(arguments)]
    value = term(*variables, vehicle)
    return [substitute(jacobian(value, v), vertcat(*variables), vertcat(*arguments)) for v in variables]
