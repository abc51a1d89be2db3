"""The figures of merit of the Thau observers on a few flights; `make bars` flies all of them."""

import pytest

from tests.bars.thau import Measured, measure

pytestmark = pytest.mark.xdist_group("thau-bars")


@pytest.fixture(scope="module")
def measured() -> Measured:
    return measure(seeds=3, healthy_flights=2, specimens=6)


def test_asmto_settles_within_50_ms_to_a_percent(measured):
    for flown in measured.estimation:
        if flown.diagnoser == "asmto":
            assert flown.settling_time <= 0.05
            assert flown.bias <= 0.01
            assert flown.std <= 0.03


def test_thau_detects_within_10_ms(measured):
    assert max(f.detection_delay for f in measured.estimation if f.diagnoser == "thau") <= 0.010


def test_every_motor_is_named(measured):
    assert {f.experiment for f in measured.estimation} == {"500 Hz", "400 Hz", "any motor", "no noise"}
    for flown in measured.estimation:
        assert flown.wrong_rotor == 0
        assert flown.isolation_delay <= 0.1


def test_healthy_flights_raise_no_alarm(measured):
    for flown in measured.health:
        assert flown.false_alarms == 0
        assert flown.peak_ratio < 1


def test_time_varying_faults_are_tracked_and_the_sliding_gain_is_bounded(measured):
    assert measured.varying_rms <= 0.03
    assert measured.largest_sliding_gain <= 0.01
