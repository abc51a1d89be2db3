"""Specimens for Monte Carlo stay within the tolerances, fill them, and follow their random numbers alone."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle, vehicle_names
from rotordx.fmus.vehicles.spread import perturbed

#: Largest relative deviation of an element, as the conventions state it.
TOLERANCES = {
    "mass": 0.02,
    "inertia": 0.04,
    "thrust_coefficient": 1.015 * 1.01 - 1,
    "torque_coefficient": 0.04,
    "drag_coefficient": 0.15,
    "motor_time_constant": 0.15,
}


@pytest.fixture(scope="module", params=vehicle_names())
def nominal(request):
    return load_vehicle(request.param)


@pytest.fixture(scope="module")
def specimens(nominal):
    rng = np.random.default_rng(1)
    return [perturbed(nominal, rng) for _ in range(2000)]


@pytest.mark.parametrize(("name", "tolerance"), TOLERANCES.items())
def test_tolerances_are_kept_and_filled(nominal, specimens, name, tolerance):
    if nominal.parameters[name] == 0:  # no tolerance of it is any
        assert {s.parameters[name] for s in specimens} == {0}
        return
    ratio = np.array([np.array(s.parameters[name]) / nominal.parameters[name] for s in specimens]) - 1
    assert np.abs(ratio).max() <= tolerance * (1 + 1e-12)
    assert ratio.min() < -0.9 * tolerance
    assert ratio.max() > 0.9 * tolerance


def test_rotors_differ_by_one_percent_around_a_common_deviation(nominal, specimens):
    ratio = np.array([s.parameters["thrust_coefficient"] for s in specimens]) / nominal.parameters["thrust_coefficient"]
    apart = ratio.max(axis=1) / ratio.min(axis=1)
    assert 1.018 < apart.max() <= 1.01 / 0.99
    k = np.array([s.parameters["torque_coefficient"] for s in specimens]) / nominal.parameters["torque_coefficient"]
    np.testing.assert_allclose(k, k[:, :1].repeat(4, axis=1), rtol=1e-14)


def test_balance_and_battery(nominal, specimens):
    offset = np.array([s.parameters["centre_of_mass"] for s in specimens]) - nominal.parameters["centre_of_mass"]
    assert 0.0009 < np.abs(offset).max() <= 0.001
    sag = 60 * np.array([s.parameters["battery_sag_rate"] for s in specimens])
    assert sag.min() >= 0
    assert 0.009 < sag.max() <= 0.01


def test_everything_else_is_nominal(nominal, specimens):
    varied = {*TOLERANCES, "centre_of_mass", "battery_sag_rate"}
    for key, value in nominal.parameters.items():
        assert key in varied or specimens[0].parameters[key] == value
    assert (specimens[0].name, specimens[0].files) == (nominal.name, nominal.files)


def test_same_random_numbers_same_specimen(nominal):
    first, second = (perturbed(nominal, np.random.default_rng(5)) for _ in range(2))
    assert first == second
    assert perturbed(nominal, np.random.default_rng(6)) != first


def test_scale(nominal):
    unscaled = perturbed(nominal, np.random.default_rng(5), scale=0)
    for key, value in nominal.parameters.items():
        np.testing.assert_allclose(unscaled.parameters[key], value, rtol=1e-15)
    assert unscaled.parameters["battery_sag_rate"] == 0
