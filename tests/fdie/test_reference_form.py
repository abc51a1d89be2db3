"""The step agrees with a second, independently written form of the method over 30,000 steps, and the FMU with both."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.fdie.reference_form import ReferenceFdie
from tests.fdie.world import DT, IDEAL, Diagnosers, World, by_name, parameter_values

NOISE = np.array([0.004, 0.02, 0.02, 0.02])
FLOORS = {
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


def samples(rotor, loss, steps, seed):
    """Noisy samples (time, command, euler, zeta) of one flight with random uncertainty and a loss from 4 s on."""
    world = World(1, seed, np.array([4.0]), np.array([rotor]), np.array([loss]))
    rng = np.random.default_rng(seed)
    for k in range(steps):
        if k:
            world.advance(np.sin(np.array([[1.3, 2.1, 3.7, 0.9]]) * world.time) * 0.8)
        noise = NOISE * np.clip(rng.standard_normal(4), -4.5, 4.5)
        yield world.time, world.command[0], world.euler[0], world.zeta[0] + noise


def recorded(flight, steps):
    """Parameters and samples of one of the flights, as arrays."""
    rotor, loss, changes = FLIGHTS[flight]
    parameters = {**IDEAL, **FLOORS, **changes}
    columns = [np.array(column) for column in zip(*samples(rotor, loss, steps, seed=10 + flight), strict=True)]
    return parameters, columns


def deviation(actual, expected):
    """Largest deviation, relative to values above one; times that are not reached are NaN in both."""
    worst = 0.0
    for name, value in expected.items():
        a, e = np.asarray(actual[name], float), np.asarray(value, float)
        assert a.shape == e.shape, name
        np.testing.assert_array_equal(np.isnan(a), np.isnan(e), err_msg=name)
        a, e = np.nan_to_num(a), np.nan_to_num(e)
        worst = max(worst, np.max(np.abs(a - e) / np.maximum(1, np.abs(e))))
    return worst


def deviation_from_reference_form(diagnoser, flight, steps):
    """Largest deviation over all outputs and steps of a flight."""
    parameters, (time, command, euler, zeta) = recorded(flight, steps)
    diagnosers = Diagnosers(1, diagnoser, **parameters)
    vehicle = World(1, 0, np.zeros(1), np.zeros(1, int), np.zeros(1)).vehicle
    reference = ReferenceFdie(SimpleNamespace(**parameter_values(**parameters)), vehicle, DT)
    worst = 0.0
    for k in range(steps):
        expected = reference.sample(time[k], command[k], euler[k], zeta[k, 1:], zeta[k, 0])
        outputs = diagnosers.sample(time[k], command[k][None], euler[k][None], zeta[k][None])
        worst = max(worst, deviation({name: value[0] for name, value in outputs.items()}, expected))
    return worst, expected


@pytest.mark.parametrize("flight", range(len(FLIGHTS)))
def test_step_equals_the_second_form(diagnoser, flight):
    worst, final = deviation_from_reference_form(diagnoser, flight, 6000)
    assert worst < 1e-12
    rotor, loss, _ = FLIGHTS[flight]
    assert final["fault_detected"] == (loss > 0)
    assert final["faulty_rotor"] == {0.0: 0, 0.8: -1}.get(loss, rotor + 1)
