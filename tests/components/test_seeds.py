"""Noise is a function of the seed: the same one repeats a flight, another one does not, FMUs never share noise."""

from itertools import islice

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

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


def generated(seed, stream):
    """Truncated normal numbers by inversion of xoshiro256++ (https://prng.di.unimi.it), written from its definition."""
    word = 2**64

    def splitmix64(counter):
        while True:
            counter = (counter + 0x9E3779B97F4A7C15) % word
            z = (counter ^ counter >> 30) * 0xBF58476D1CE4E5B9 % word
            z = (z ^ z >> 27) * 0x94D049BB133111EB % word
            yield z ^ z >> 31

    def rotated(x, k):
        return (x << k) % word | x >> (64 - k)

    s = list(islice(splitmix64(seed ^ int.from_bytes(stream.encode(), "big")), 4))
    while True:
        result = (rotated((s[0] + s[3]) % word, 23) + s[0]) % word
        shifted = (s[1] << 17) % word
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= shifted
        s[3] = rotated(s[3], 45)
        tail = ndtr(-4.5)
        yield ndtri(tail + (1 - 2 * tail) * ((result >> 12) + 0.5) / 2**52)


def test_noise_is_that_of_the_published_generator(component):
    gust = component("plant", seed=12, gust_std=[1.0] * 6, gust_limit=[9.0] * 6).initialise()["disturbance"]
    np.testing.assert_allclose(gust, list(islice(generated(12, "plant"), 6)), rtol=1e-11)

    sensors = component(
        "sensors", seed=12, gyro_noise_std=1.0, motion_capture_period=1.0
    )  # no capture but at the start
    gyro = sensors.initialise().run(400)["body_rate"]
    captured = 64 * 6
    expected = np.array(list(islice(generated(12, "sensors"), captured, captured + gyro.size)))
    np.testing.assert_allclose(gyro, expected.reshape(gyro.shape), rtol=1e-11)
