"""The observers as differential equations of an F450, written anew from the paper with its misprints corrected.

Axes front, right, down; motors 1 front, 2 rear, 3 left, 4 right; U2 = b L (O3^2 - O4^2), U3 = b L (O1^2 - O2^2),
U4 = d (O1^2 + O2^2 - O3^2 - O4^2); O = O3 + O4 - O1 - O2.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

L, B, D, J_T = 0.225, 9.8e-6, 1.6e-7, 2.8e-6  # table 1
IX, IY, IZ = 0.0035, 0.0035, 0.005
LAG = 0.02  # s, of the vehicle file

#: commands before and from STEPPED on, rad/s; so uneven that the rotors' momentum shows
BEFORE = np.array([820.0, 790.0, 600.0, 640.0])
AFTER = np.array([760.0, 815.0, 650.0, 560.0])
STEPPED = 0.06  # s

_ROW, _COLUMN = np.indices((6, 6))
#: gains without symmetry, so that a transposed or swapped one is another one
K = np.diag([90.0, 100.0, 110.0, 80.0, 95.0, 105.0]) + np.cos(_ROW + 2.0 * _COLUMN) * 3
F2 = np.array([[-26, 5, 5, 13946, 5, 5], [5, -24, 5, 5, 12887, 5], [3, 3, -16, 3, 3, 8701]]) * 1.2
RATE = np.array([0.005, 0.004, 0.003])
LEAK = 6.0


@dataclass(frozen=True)
class Sliding:
    """The sliding term of `asmto`; by default there is none."""

    direction: np.ndarray = field(default_factory=lambda: np.zeros(6))
    surface: np.ndarray = field(default_factory=lambda: np.zeros(6))
    rate: float = 0.0
    leak: float = 0.0
    layer: float = 1.0
    dead_zone: float = 0.0


def measured(t):
    """y: three angles and three rates, smooth and independent of each other."""
    angles = [0.3 * np.sin(2 * t), 0.2 * np.cos(3 * t), 0.4 * np.sin(1.5 * t + 1)]
    rates = [0.9 * np.sin(5 * t), 0.8 * np.cos(4 * t), 1.1 * np.sin(3 * t + 0.5)]
    return np.array(angles + rates)


def linearly_measured(t):
    """y that a line through two samples meets exactly."""
    return np.array([0.1, -0.05, 0.2, 0.3, -0.2, 0.25]) + np.array([0.2, 0.1, -0.1, 0.5, -0.4, 0.3]) * t


def rotor_speed(t, stepped=STEPPED):
    """Speeds after the lag of the motors."""
    return BEFORE if t <= stepped else AFTER + (BEFORE - AFTER) * np.exp(-(t - stepped) / LAG)


def model(x, speed):
    """A x + p(x, u) + B u with Euler's kinematics in the place of the identity."""
    roll, pitch, _, p, q, r = x
    o1, o2, o3, o4 = speed
    momentum = J_T * (o3 + o4 - o1 - o2)
    return np.array(
        [
            p + np.tan(pitch) * (q * np.sin(roll) + r * np.cos(roll)),
            q * np.cos(roll) - r * np.sin(roll),
            (q * np.sin(roll) + r * np.cos(roll)) / np.cos(pitch),
            (B * L * (o3**2 - o4**2) + (IY - IZ) * q * r - momentum * q) / IX,
            (B * L * (o1**2 - o2**2) + (IZ - IX) * p * r + momentum * p) / IY,
            (D * (o1**2 + o2**2 - o3**2 - o4**2) + (IX - IY) * p * q) / IZ,
        ]
    )


def solution(duration, adaptive, sliding=None, y=measured, stepped=STEPPED):
    """[x_hat (6), f_hat (3), n] at the end, from x_hat(0) = y(0), f_hat(0) = 0, n(0) = 0."""
    term = sliding or Sliding()

    def rate(t, z):
        x, fault, n = z[:6], z[6:9], z[9]
        e = x - y(t)
        distance = term.surface @ e
        v = -n * np.clip(distance / term.layer, -1, 1)
        drive = np.concatenate((np.zeros(3), fault / [IX, IY, IZ]))
        return np.concatenate(
            (
                model(x, rotor_speed(t, stepped)) + drive - K @ e + term.direction * v,
                -RATE * (F2 @ e + LEAK * fault) if adaptive else np.zeros(3),
                [term.rate * max(abs(distance) - term.dead_zone, 0) - term.leak * n],
            )
        )

    z = np.concatenate((y(0.0), np.zeros(4)))
    for begin, end in ((0.0, min(stepped, duration)), (min(stepped, duration), duration)):
        if end > begin:  # the command steps between the two
            z = solve_ivp(rate, (begin, end), z, method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    return z
