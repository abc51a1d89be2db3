"""The part of the threshold that stands for random noise: its energies, its quantiles, its certificate."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters
from rotordx.gains import margins, packaged, rho_adaptive, window_noise
from rotordx.gains.options import DesignError, with_settings
from rotordx.gains.verify import checks

DT, WINDOW = 0.002, 0.1
FILE = packaged.packaged_designs() / "lab_x" / "rho_adaptive.json"


@dataclass(frozen=True)
class Noises:
    """Random noise of sensors, and the residual that it leaves: independent of the module under test."""

    gyro: np.ndarray
    position: np.ndarray
    held: int

    def windows(self, sensors, count: int, rng) -> np.ndarray:
        """Residuals (count, samples, channels) of independent windows, each with its own past."""
        samples, memory = round(WINDOW / DT), len(self.gyro)
        total = samples + memory + self.held
        white = rng.normal(size=(count, total, 3)) * sensors.gyro_noise_std
        capture = rng.normal(size=(count, total // self.held + 1)) * sensors.motion_capture_position_noise_std
        captured = np.repeat(capture, self.held, axis=1)[:, :total]
        found = np.zeros((count, samples, self.gyro.shape[1]))
        for lag in range(memory):
            part = slice(total - samples - lag, total - lag)
            found += white[:, part] @ self.gyro[lag].T
            found += captured[:, part, None] * self.position[lag, :, 0]
        return found


@pytest.fixture(scope="module")
def responses():
    """Impulse responses of a residual of two channels that remembers 0.1 s."""
    time = DT * np.arange(60)
    gyro = np.zeros((60, 2, 3))
    gyro[:, 0, 0], gyro[:, 1, 1] = np.exp(-40 * time), 0.5 * np.exp(-60 * time) * np.cos(100 * time)
    position = np.zeros((60, 2, 1))
    position[:, 1, 0] = 3 * np.exp(-50 * time)
    still = np.zeros((60, 2, 3))
    return margins.Responses(np.zeros((60, 2, 4)), gyro, still, position, DT)


@pytest.fixture(scope="module")
def sensors():
    return load_vehicle("lab_x").fill(SensorParameters)


@pytest.fixture(scope="module")
def mean_squares(responses, sensors):
    noises = Noises(responses.gyro, responses.position, round(sensors.motion_capture_period / DT))
    found = noises.windows(sensors, 20000, np.random.default_rng(1))
    return np.mean(np.sum(found**2, axis=2), axis=1), found


def test_energies_are_mean_and_variance_of_the_mean_square(responses, sensors, mean_squares):
    total, root, _ = window_noise.energies(responses, sensors, WINDOW)
    assert np.mean(mean_squares[0]) == pytest.approx(total, rel=0.02)
    assert np.var(mean_squares[0]) == pytest.approx(2 * root**2, rel=0.08)


def test_quantiles_are_exceeded_at_most_as_often_as_they_say(responses, sensors, mean_squares):
    energies = window_noise.energies(responses, sensors, WINDOW)
    squares, found = mean_squares
    course = np.zeros(found.shape[1:])
    course[:, 1] = 1.0  # along the noise that lasts longest
    along = np.mean(np.sum(found * course, axis=2), axis=1) / np.sqrt(np.mean(np.sum(course**2, axis=1)))
    for exponent in (0.5, 1.0, 3.0, 6.0):
        rms, projection = window_noise.quantiles(energies, np.sqrt(exponent))
        assert np.mean(np.sqrt(squares) > rms) <= np.exp(-exponent)
        assert np.mean(along > projection) <= np.exp(-exponent)
    assert np.max(np.sqrt(squares)) > 0.8 * rms
    assert np.max(along) > 0.5 * projection


@pytest.mark.parametrize(
    ("name", "claim"),
    [("noise_rms", "noise: noise in the window"), ("noise_projection", "noise: noise along a course")],
)
def test_a_threshold_with_less_room_for_noise_is_refused(name, claim):
    document = json.loads(FILE.read_text(encoding="utf-8"))
    document["parameters"][name] *= 0.95
    failed = [check.what for check in checks(document, FILE) if not check.passed]
    assert claim in failed


def test_noise_of_limited_amplitude_makes_the_threshold_of_the_theorem():
    options = with_settings(rho_adaptive.Options(), ["noise_form=amplitude"])
    design = rho_adaptive.design(load_vehicle("lab_x"), options)
    assert design.parameters["noise_bound"] == pytest.approx(4.5 * np.sqrt(3 * 0.02**2 + 0.00894427**2), rel=1e-5)
    assert design.parameters["noise_rms"] == design.parameters["noise_projection"] == rho_adaptive.NUMERICAL_FLOOR
    assert [c.name for c in design.certificates] == ["detection", "adaptation"]
    bound = next(c.figures["steady_residual_bound"] for c in design.certificates if c.name == "detection")
    assert bound > 4 * design_bound(FILE)


def design_bound(path: Path) -> float:
    document = json.loads(path.read_text(encoding="utf-8"))
    return next(c["figures"]["steady_residual_bound"] for c in document["certificates"] if c["name"] == "detection")


def test_a_step_that_is_too_long_is_named():
    with pytest.raises(DesignError, match="spectral radius"):
        rho_adaptive.design(load_vehicle("lab_x"), with_settings(rho_adaptive.Options(), ["step_size=0.4"]))
