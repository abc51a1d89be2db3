"""The figures of merit of `askf` and `msjfo` on a few flights; `make bars` flies all of them."""

import numpy as np
import pytest

from rotordx.fmus.diagnosers.codegen import diagnoser_function
from tests.bars.kalman import DIAGNOSERS, count_operations, fly_healthy, fly_losses

DENSE, STAGED = "ASKF, dense", "multi-stage, symmetric (`msjfo`)"


@pytest.fixture(scope="module")
def losses():
    return fly_losses(range(2))


@pytest.mark.xdist_group("kalman_bars")
@pytest.mark.parametrize(("loss", "delay"), [(0.2, 0.2), (0.1, 0.6)])
def test_losses_are_flagged_in_time_and_the_right_rotor_is_named(losses, loss, delay):
    flown = [flight for flight in losses if flight.loss == loss]
    assert len(flown) == 2 * 4 * len(DIAGNOSERS)
    assert max(flight.detection_delay for flight in flown) <= delay
    assert [flight.named for flight in flown] == [flight.rotor for flight in flown]


@pytest.mark.xdist_group("kalman_bars")
def test_the_estimate_is_steady_and_its_innovations_are_as_large_as_they_should(losses):
    assert max(flight.mean_square_error for flight in losses) <= 5e-6
    assert max(flight.verdict_mean_square_error for flight in losses) <= 5e-6
    assert 0.95 <= np.mean([flight.gyro_innovation for flight in losses]) <= 1.05


@pytest.mark.xdist_group("kalman_bars")
@pytest.mark.parametrize("motion", ["healthy_circle", "vertical_sine"])
def test_gusts_raise_no_alarm_with_the_common_mode_step(motion):
    flown = fly_healthy(range(3), motion)
    assert not [flight for flight in flown if flight.false_alarm]
    assert max(flight.peak_ratio for flight in flown) <= 0.9


@pytest.mark.parametrize("size", [(8, 4, 4), (12, 4, 6)])
def test_the_multi_stage_filter_needs_at_most_65_percent_of_a_dense_one(size):
    counted = count_operations([size])[size]
    assert counted[STAGED] <= 0.65 * counted[DENSE]
    assert counted[STAGED] >= 0.9 * counted["ASKF, block-structured (`askf`)"]  # no less than one with blocks


@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_a_step_fits_the_budget(diagnoser):
    assert diagnoser_function(diagnoser).n_instructions() <= 8000
