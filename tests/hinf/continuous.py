"""The observers as differential equations of lab_x, written anew from the paper with the README's deviations.

Axes front, right, down; rotors 1 front left, 2 front right, 3 rear right, 4 rear left; a = d / sqrt(2):
roll torque b a (O1^2 - O2^2 - O3^2 + O4^2), pitch b a (O1^2 + O2^2 - O3^2 - O4^2), yaw k (O1^2 - O2^2 + O3^2 - O4^2).
"""

import numpy as np
from scipy.integrate import solve_ivp

from rotordx.fmus.vehicles import load_design

M, G, DRAG, A = 1.5, 9.81, 0.25, 0.225 / np.sqrt(2)
J = np.array([0.022, 0.024, 0.040])
B, K, J_R, LAG, W0 = 1.2e-5, 2e-7, 6e-5, 0.03, 20.0
TORQUES = np.array([[1, -1, -1, 1], [1, 1, -1, -1], [1, -1, 1, -1]]) * np.array([[B * A], [B * A], [K]])
HOVER = np.sqrt(M * G / 4 / B)
#: rad/s2 about each axis by the total loss of a rotor in hover
SCALE = np.abs(TORQUES).max(axis=1) * HOVER**2 / J

#: commands before and from STEPPED on, rad/s; so uneven that the rotors' momentum shows
BEFORE = np.array([600.0, 500.0, 580.0, 530.0])
AFTER = np.array([560.0, 520.0, 610.0, 490.0])
STEPPED = 0.1  # s


def _uneven(values, shape):
    """A designed gain without its zeros and symmetries, so that a transposed or swapped one is another one."""
    row, column = np.indices(shape)
    return np.array(values).reshape(shape) + 0.3 * np.cos(row + 2.0 * column)


_DESIGN = load_design("lab_x", "hinf")["parameters"]
_BASELINE = load_design("lab_x", "fast_adaptive")["parameters"]
VZ4_GAIN = _uneven(_DESIGN["observer_gain"], (13, 7))
TAU3_GAIN = _uneven(_DESIGN["torque_observer_gain"], (9, 6))
L = _uneven(_BASELINE["observer_gain"], (6, 6))
F = _uneven(_BASELINE["fault_gain"], (3, 6))
RATE, SIGMA = np.array(_BASELINE["learning_rate"]), _BASELINE["integral_rate"]


def measured(t):
    """Roll, pitch, yaw, p, q, r, v_z: smooth and independent of each other."""
    angles = [0.3 * np.sin(2 * t), 0.2 * np.cos(3 * t), 0.4 * np.sin(1.5 * t + 1)]
    rates = [0.5 * np.sin(5 * t), 0.4 * np.cos(4 * t), 0.6 * np.sin(3 * t + 0.5)]
    return np.array([*angles, *rates, 0.3 * np.sin(2.5 * t + 0.3)])


def rotor_speed(t):
    """Speeds after the lag of the motors."""
    return BEFORE if t <= STEPPED else AFTER + (BEFORE - AFTER) * np.exp(-(t - STEPPED) / LAG)


def kinematics(euler, rate):
    """R_eta omega."""
    roll, pitch, _ = euler
    p, q, r = rate
    turning = q * np.sin(roll) + r * np.cos(roll)
    return np.array([p + np.tan(pitch) * turning, q * np.cos(roll) - r * np.sin(roll), turning / np.cos(pitch)])


def angular_acceleration(rate, squared, speed):
    """Of the body, by squared rotor speeds; the rotors' momentum is that of healthy ones."""
    p, q, r = rate
    momentum = -J_R * (speed[0] - speed[1] + speed[2] - speed[3])
    euler = np.array([(J[1] - J[2]) * q * r, (J[2] - J[0]) * p * r, (J[0] - J[1]) * p * q])
    return (TORQUES @ squared + euler + np.array([-q, p, 0.0]) * momentum) / J


def vz4(t, z):
    """[roll, pitch, yaw, p, q, r, filtered v_z, lag, v_z, minus the losses (4)]."""
    y, speed = measured(t), rotor_speed(t)
    left = speed**2 * (1 + z[9:])
    upright = np.cos(y[0]) * np.cos(y[1])
    model = np.concatenate(
        (
            kinematics(y[:3], z[3:6]),
            angular_acceleration(z[3:6], left, speed),
            [W0**2 * z[7] - 2 * W0 * z[6], z[8] - z[6], G - DRAG / M * z[8] - upright / M * B * left.sum()],
            np.zeros(4),
        )
    )
    injection = VZ4_GAIN @ (y - z[:7])
    injection[9:] *= HOVER**2 / speed**2
    return model + injection


def tau3(t, z):
    """[roll, pitch, yaw, p, q, r, torque faults (3)], in units of what the loss of a rotor takes away in hover."""
    y, speed = measured(t)[:6], rotor_speed(t)
    fault = SCALE * z[6:]
    model = (kinematics(y[:3], z[3:6]), angular_acceleration(z[3:6], speed**2, speed) + fault, np.zeros(3))
    return np.concatenate(model) + TAU3_GAIN @ (y - z[:6])


def fast_fault(error, integral):
    """Torque fault of fast_adaptive."""
    return -RATE * (F @ error + SIGMA * integral)


def fast_adaptive(t, z):
    """[roll, pitch, yaw, p, q, r, integral of F e_y]."""
    y, speed = measured(t)[:6], rotor_speed(t)
    error = z[:6] - y
    fault = fast_fault(error, z[6:]) / J
    model = (kinematics(y[:3], z[3:6]), angular_acceleration(z[3:6], speed**2, speed) + fault)
    return np.concatenate((np.concatenate(model) - L @ error, F @ error))


def solution(rate, start, duration):
    """State at the end."""
    z = np.asarray(start, dtype=float)
    for begin, end in ((0.0, STEPPED), (STEPPED, duration)):  # the command steps between the two
        z = solve_ivp(rate, (begin, end), z, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return z
