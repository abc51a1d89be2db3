"""The figures of merit of `fdie` on 60 flights; `make bars` flies all of them."""

import pytest

from tests.bars.fdie import Faulty, Healthy, fly_all

#: loss -> largest detection and isolation delay, s
DELAYS = {0.05: (1.5, 2.5), 0.1: (0.2, 0.45), 0.2: (0.1, 0.25), 0.4: (0.1, 0.25)}
ROTORS = (1, 2, 3, 4)


@pytest.fixture(scope="module")
def flown() -> tuple[list[Healthy], list[Faulty]]:
    return fly_all([0, 1], circles=10, sines=4, losses=list(DELAYS), rotors=ROTORS, workers=1)


@pytest.mark.xdist_group("bars")
def test_healthy_flights_raise_no_alarm(flown):
    healthy, _ = flown
    assert len(healthy) == 28
    assert not [flight for flight in healthy if flight.false_alarm]
    assert max(flight.peak_ratio for flight in healthy) <= 0.9


@pytest.mark.xdist_group("bars")
@pytest.mark.parametrize("loss", DELAYS)
def test_losses_are_detected_and_isolated_in_time(flown, loss):
    faulty = [flight for flight in flown[1] if flight.loss == loss]
    detection, isolation = DELAYS[loss]
    assert len(faulty) == 2 * len(ROTORS)
    assert max(flight.detection_delay for flight in faulty) <= detection
    assert max(flight.isolation_delay for flight in faulty) <= isolation
    assert [flight.named for flight in faulty] == [flight.rotor for flight in faulty]


@pytest.mark.xdist_group("bars")
def test_the_paper_rule_never_names_a_wrong_rotor(flown):
    assert not [flight for flight in flown[1] if flight.paper_named not in (0, flight.rotor)]


@pytest.mark.xdist_group("bars")
def test_a_loss_of_20_percent_is_estimated_within_a_second(flown):
    faulty = [flight for flight in flown[1] if flight.loss == 0.2]
    assert max(flight.error_after_1_s for flight in faulty) <= 0.03
    assert max(abs(flight.final_error) for flight in faulty) <= 0.01
