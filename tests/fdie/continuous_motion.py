"""Exact continuous motion of the vehicle under commands that are held for a step, from the paper's equations."""

from __future__ import annotations

import numpy as np

from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from tests.equations import paper_model
from tests.fdie.world import DT, FILTER_BANDWIDTH


def continuous_flight():
    """Samples (command, state of `motion`) of 2.5 s."""
    vehicle = load_vehicle("lab_x").fill(VehicleParameters)
    x = np.zeros(13)
    x[7:11] = swaying_command(0.0, x, vehicle)
    samples = [(x[7:11].copy(), x)]
    for k in range(1, 1251):
        target = swaying_command(k * DT, x, vehicle)
        for _ in range(2):
            x = runge_kutta(motion, x, DT / 2, target, vehicle)
        samples.append((target, x))
    assert all(abs(x[1:3]).max() < 0.7 for _, x in samples)  # flown upright
    return samples


def swaying_command(t, x, vehicle):
    """Rotor speeds that sway the vehicle about all axes and keep it upright."""
    hover = np.sqrt(vehicle.mass * vehicle.gravity / vehicle.thrust_coefficient.sum())
    sway = np.array([25 * np.cos(7 * t), 20 * np.cos(5 * t), 60 * np.cos(3 * t), 15 * np.cos(4 * t)])
    hold = np.array([*(-60 * x[1:4] - 15 * x[4:7]), 40 * x[0]])
    signs = np.array([[1, -1, -1, 1], [1, 1, -1, -1], [1, -1, 1, -1], [1, 1, 1, 1]])
    return hover + (sway + hold) @ signs


def motion(x, target, vehicle):
    """Time derivative of [v_z, euler, body rates, rotor speeds, filtered v_z and its rate], exactly as in the paper."""
    velocity, euler, rate, speed, filtered, slope = x[0], x[1:4], x[4:7], x[7:11], x[11], x[12]
    return np.array(
        [
            paper_model.acceleration(np.array([0, 0, velocity]), euler, speed, vehicle)[2],
            *paper_model.euler_rate(euler, rate),
            *paper_model.angular_acceleration(euler, rate, speed, vehicle),
            *((target - speed) / vehicle.motor_time_constant),
            slope,
            FILTER_BANDWIDTH**2 * (velocity - filtered) - 2 * FILTER_BANDWIDTH * slope,
        ]
    )


def runge_kutta(function, x, dt, *arguments):
    k1 = function(x, *arguments)
    k2 = function(x + dt / 2 * k1, *arguments)
    k3 = function(x + dt / 2 * k2, *arguments)
    k4 = function(x + dt * k3, *arguments)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
