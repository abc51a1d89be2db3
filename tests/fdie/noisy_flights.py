"""Noisy flights of a world with uncertainty, through `fdie` and through its second form."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from tests.fdie.reference_form import ReferenceFdie
from tests.fdie.world import DT, IDEAL, Diagnosers, World, constants, parameter_values

NOISE = np.array([0.004, 0.02, 0.02, 0.02])
NOISY = {
    **IDEAL,
    "detection_noise_floor": np.array([0.04, 0.09, 0.09, 0.09]),
    "isolation_noise_floor": np.array([0.038, 0.089, 0.089, 0.09]),
}
#: rotor, loss, changed parameters of each flight: both rules, every rotor, a loss outside Theta (no rotor is left)
FLIGHTS = [
    (0, 0.2, {}),
    (1, 0.45, {"isolation_rule": 0, "learning_rate": 0.05}),
    (2, 0.8, {"loe_max": 0.3}),
    (3, 0.1, {"dwell_time": 0.1, "warm_up_time": 2.0, "motor_lag_margin": 1.5}),
    (0, 0.0, {"estimate_memory_time": 0.5}),
]


STEPS = 6000


def flown(steps, flights=FLIGHTS):
    """Noisy samples of the flights with random uncertainty and losses from 4 s on; arrays (steps, flight, size)."""
    rotor, loss = np.array([f[0] for f in flights]), np.array([f[1] for f in flights])
    world = World(len(flights), 10, np.full(len(flights), 4.0), rotor, loss)
    rng = np.random.default_rng(10)
    rows = []
    for k in range(steps):
        if k:
            world.advance(np.sin(np.array([1.3, 2.1, 3.7, 0.9]) * world.time) * np.full((len(flights), 1), 0.8))
        noise = NOISE * np.clip(rng.standard_normal(world.zeta.shape), -4.5, 4.5)
        rows.append((world.command, world.euler, world.zeta + noise))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def by_step(diagnoser, samples, flights=FLIGHTS):
    """Outputs (steps, flight, ...) of the step by name."""
    diagnosers = Diagnosers(len(flights), diagnoser)
    diagnosers.p = np.array([constants(**NOISY | changes) for *_, changes in flights])
    history = [diagnosers.sample(k * DT, *sample) for k, sample in enumerate(zip(*samples, strict=True))]
    return {name: np.array([outputs[name] for outputs in history]) for name in history[0]}


def by_reference_form(samples, flight):
    """Outputs (steps, ...) of the second form by name."""
    parameters = parameter_values(**NOISY | flight[2])
    reference = ReferenceFdie(SimpleNamespace(**parameters), load_vehicle("lab_x").fill(VehicleParameters), DT)
    history = []
    for k, (command, euler, zeta) in enumerate(zip(*samples, strict=True)):
        outputs = reference.sample(k * DT, command, euler, zeta[1:], zeta[0])
        history.append({name: np.array(value, float) for name, value in outputs.items()})
    return {name: np.array([outputs[name] for outputs in history]) for name in history[0]}


def deviation(actual, expected):
    """Largest deviation of any output, relative to values above one; times not reached are NaN in both."""
    assert list(actual) == list(expected)
    worst = 0.0
    for name in expected:
        np.testing.assert_array_equal(np.isnan(actual[name]), np.isnan(expected[name]), err_msg=name)
        a, e = np.nan_to_num(actual[name]), np.nan_to_num(expected[name])
        worst = max(worst, np.max(np.abs(a - e) / np.maximum(1, np.abs(e))))
    return worst
