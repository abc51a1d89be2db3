"""The model of one step is the vehicle's motion: against an integration of the continuous equations, written anew."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rotordx.fmus.diagnosers import rotor_losses
from rotordx.fmus.diagnosers.interface import Command, Measured
from rotordx.fmus.model_terms import terms
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from tests.mutation import mutate

VEHICLE = load_vehicle("lab_x").fill(VehicleParameters)
BANDWIDTH = 20.0
EULER = np.array([0.2, -0.15, 0.4])
LOSS = np.array([0.2, 0.0, 0.1, 0.05])
NOISE = 0.003  # m, held position error
HOLD = 0.008  # s, commands are held so long
DURATION = 0.4
UNIT = VEHICLE.mass * VEHICLE.gravity / np.sum(VEHICLE.thrust_coefficient)


def command(k):
    """Held over the k-th interval of commands."""
    return 550 + 60 * np.sin(0.9 * k + np.arange(4)) + [20, -10, 5, -15]


def derivative(x, commanded):
    """Of [v_z, p, q, r, lag of the filtered position, filtered v_z, lacking thrust (4), rotor speed (4)]."""
    v = VEHICLE
    vz, p, q, r, lag, filtered = x[:6]
    lacking, speed = x[6:10], x[10:]
    squared = speed**2 + UNIT * lacking
    bx, by = np.asarray(v.rotor_x), np.asarray(v.rotor_y)
    thrust = v.thrust_coefficient * squared
    jx, jy, jz = v.inertia
    momentum = -v.rotor_inertia * np.dot(v.rotor_direction, speed)
    tilt = np.cos(EULER[0]) * np.cos(EULER[1])
    rates = [
        (-thrust @ by + (jy - jz) * q * r - q * momentum) / jx,
        (thrust @ bx + (jz - jx) * p * r + p * momentum) / jy,
        (np.dot(v.rotor_direction, v.torque_coefficient * squared) + (jx - jy) * p * q) / jz,
    ]
    vertical = v.gravity - tilt * thrust.sum() / v.mass - v.drag_coefficient / v.mass * vz
    tau = v.motor_time_constant
    return np.concatenate(
        [
            [vertical, *rates],
            [vz - BANDWIDTH * (lag + NOISE), BANDWIDTH**2 * (lag + NOISE) - BANDWIDTH * filtered],
            (-LOSS * commanded**2 / UNIT - lacking) / tau,
            (commanded - speed) / tau,
        ]
    )


def start():
    lacking = -LOSS * 0.5
    return np.concatenate([[0.4, 0.3, -0.5, 0.2, 0.01, 0.35], lacking, np.full(4, 540.0)])


def motion(step_size):
    """States (N + 1, 14) at multiples of the step."""
    states, x = [start()], start()
    per_hold = round(HOLD / step_size)
    for k in range(round(DURATION / HOLD)):
        at = step_size * np.arange(1, per_hold + 1)
        solution = solve_ivp(
            lambda t, x, k=k: derivative(x, command(k)),
            (0, HOLD),
            x,
            rtol=1e-10,
            atol=1e-12,
            t_eval=at,
            method="DOP853",
        )
        x = solution.y[:, -1]
        states.extend(solution.y.T)
    return np.array(states)


def stepped(step_size):
    """States (N + 1, 10) of the diagnosers' model, which is told body rates and commands."""
    true = motion(step_size)
    inputs = ca.SX.sym("x", 10), ca.SX.sym("u", 4), ca.SX.sym("rate", 3), ca.SX.sym("before", 3), ca.SX.sym("speed", 4)
    x, u, rate, before, speed = inputs
    state = SimpleNamespace(started=1, rotor_speed=speed, body_rate=before)
    measured = Measured(euler=ca.SX(EULER), body_rate=rate, vertical_velocity=0)
    interval = rotor_losses.known_interval(measured, Command(rotor_speed_command=u), state, VEHICLE, step_size)
    after = rotor_losses.transition(x, ca.SX(LOSS), NOISE, interval, BANDWIDTH, VEHICLE, step_size)
    step = ca.Function("step", inputs, [after, interval.rotor_speed])
    states, speed = [true[0, :10]], true[0, 10:]
    for k in range(1, len(true)):
        x, speed = step(states[-1], command(int((k - 0.5) * step_size / HOLD)), true[k, 1:4], true[k - 1, 1:4], speed)
        states.append(np.array(x).ravel())
    return np.array(states), true


def largest_errors(step_size):
    """Of each state (10)."""
    states, true = stepped(step_size)
    return np.abs(states - true[:, :10]).max(axis=0)


def test_the_step_is_of_second_order_and_exact_in_the_lags():
    coarse, fine = largest_errors(0.004), largest_errors(0.002)
    assert np.all(coarse[:6] / fine[:6] > 3.8)
    assert fine[:4].max() < 1e-4  # rad/s after 0.4 s, of rates that change by several rad/s
    assert fine[4:6].max() < 2e-5
    assert fine[6:].max() < 1e-9


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        (rotor_losses.transition, "wanted = -interval.thrust * loss", "wanted = interval.thrust * loss"),
        (rotor_losses.transition, "wanted + hold / dt * (lacking - wanted)", "lacking"),
        (rotor_losses.transition, "velocity = (v_z + v_z_after) / 2", "velocity = v_z"),
        (rotor_losses.transition, "velocity / bandwidth - position_noise", "velocity / bandwidth + position_noise"),
        (rotor_losses.transition, "((1 - drag) * v_z", "((1 + drag) * v_z"),
        (rotor_losses.known_interval, "(speed_before + speed) / 2", "speed"),
        (rotor_losses.known_interval, "vertcat(0, mean_rate)", "vertcat(0, rate_before)"),
        (terms.coupling_torque, "vertcat(0, 0, rotor_momentum)", "0 * vertcat(0, 0, rotor_momentum)"),
        (terms.input_gain, "cos(euler[0]) * cos(euler[1])", "1"),
    ],
)
def test_mistakes_in_the_step_lose_that_order(function, old, new, monkeypatch):
    mutate(monkeypatch, function, old, new)
    with pytest.raises(AssertionError):
        test_the_step_is_of_second_order_and_exact_in_the_lags()
