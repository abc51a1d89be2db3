"""The CrazyPAD mapping has the signs of the dynamics, shown by the data alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from rotordx.fmus.model_terms.allocation import allocation_rows
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters

RATE = 500.0


def between(low, high, signal):
    """The part of a signal between two frequencies (Hz), without the ends where the filter settles."""
    filtered = sosfiltfilt(butter(2, [low, high], btype="band", fs=RATE, output="sos"), signal, axis=0)
    return filtered[500:-500]


def correlation(pairs):
    """Correlation of signals over all parts of all logs together."""
    left, right = (np.concatenate(signals) for signals in zip(*pairs, strict=True))
    return (left * right).mean(axis=0) / (left.std(axis=0) * right.std(axis=0))


@pytest.fixture(scope="module")
def parts(flights):
    """(part, position) of all logs."""
    return [pair for flight in flights.values() for pair in zip(flight.parts, flight.positions, strict=True)]


def test_the_craft_is_stabilised(parts):
    """A stable rate loop answers a rate with a torque against it: all signs of gyro, mixer and geometry agree."""
    allocation = np.array(allocation_rows(load_vehicle("crazyflie").fill(VehicleParameters)))
    answered = correlation(
        (between(2, 20, part.body_rate), between(2, 20, part.rotor_speed_command**2 @ allocation[1:].T))
        for part, _ in parts
    )
    assert (answered < -0.3).all(), answered


def test_tilt_accelerates_the_craft_to_its_side(parts):
    """Which way is which: with the right side down it accelerates to the right, with the nose up backwards."""
    tilted = correlation(
        (
            between(0.8, 2, np.cumsum(part.body_rate[:, :2], axis=0) / RATE),
            between(0.8, 2, np.gradient(np.gradient(position[:, 1::-1], axis=0), axis=0) * RATE**2),
        )
        for part, position in parts
    )
    assert tilted[0] > 0.5, tilted
    assert tilted[1] < -0.5, tilted


def test_vertical_velocity_is_that_of_the_altitude(parts):
    """Filter (33) lets it follow by 0.1 s."""
    delay = round(0.1 * RATE)
    followed = correlation(
        (between(0.2, 2, np.gradient(position[:, 2]))[:-delay], between(0.2, 2, part.vertical_velocity)[delay:])
        for part, position in parts
    )
    assert followed > 0.6


def test_more_thrust_is_more_specific_force(parts):
    """Commands are thrust, not speed, and up is up: it accelerates upwards when the sum of the commands rises."""
    lifted = correlation(
        (
            between(0.3, 2, np.sum(part.rotor_speed_command**2, axis=1)),
            -between(0.3, 2, np.gradient(part.vertical_velocity)),
        )
        for part, _ in parts
    )
    assert lifted > 0.3
