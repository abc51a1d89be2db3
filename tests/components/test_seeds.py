"""Randomness is a function of the seed: the same seed repeats a flight, another one does not, FMUs never share noise."""

import numpy as np
import pytest

NOISY = {"sensors": ("body_rate", {}), "plant": ("disturbance", {"gust_std": [0.1] * 6, "gust_limit": [1.0] * 6})}


def noise(component, name, seed):
    output, parameters = NOISY[name]
    return component(name, seed=seed, **parameters).initialise().run(2000)[output]


@pytest.mark.parametrize("name", NOISY)
def test_the_same_seed_repeats_bit_by_bit(component, name):
    np.testing.assert_array_equal(noise(component, name, 7), noise(component, name, 7))


@pytest.mark.parametrize("name", NOISY)
def test_neighbouring_seeds_are_unrelated(component, name):
    first, second = (np.diff(noise(component, name, seed), axis=0) for seed in (7, 8))
    assert np.abs(np.corrcoef(first.T, second.T)[: first.shape[1], first.shape[1] :]).max() < 0.1


def test_plant_and_sensors_with_one_seed_are_unrelated(component):
    gust, gyro = (np.diff(noise(component, name, 7), axis=0) for name in ("plant", "sensors"))
    for lag in range(-3, 4):
        shifted = np.roll(gust, lag, axis=0)
        assert np.abs(np.corrcoef(shifted.T, gyro.T)[:6, 6:]).max() < 0.1


@pytest.mark.parametrize("seed", [0, 2**53])
def test_any_seed_gives_noise(component, seed):
    values = noise(component, "sensors", seed)
    assert values.std() == pytest.approx(0.02, rel=0.05)
