"""Every fault observer on lab_x: silent on healthy specimens, right about a loss; `make bars` flies all of it."""

import numpy as np
import pytest

from tests.bars.lab_x import DIAGNOSERS, Result, faulty_flights, fly_all, healthy_flights

#: those that name a rotor that lost 10 %; the margins of `fast_adaptive`, the noisiest one, do not let it
SENSITIVE = [name for name in DIAGNOSERS if name != "fast_adaptive"]
HEALTHY = 8


@pytest.fixture(scope="module")
def results() -> list[Result]:
    return fly_all([*healthy_flights(HEALTHY), *faulty_flights(1)], workers=1)


def of(results: list[Result], diagnoser: str, kind: str) -> list[Result]:
    return [r for r in results if (r.diagnoser, r.flight.kind) == (diagnoser, kind)]


@pytest.mark.xdist_group("bars")
@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_healthy_specimens_raise_no_alarm(results, diagnoser):
    healthy = of(results, diagnoser, "healthy")
    assert len(healthy) == HEALTHY
    assert not [r.flight for r in healthy if r.false_alarm]
    assert max(r.peak_ratio for r in healthy) < 1


@pytest.mark.xdist_group("bars")
@pytest.mark.parametrize("kind", ["20 %", "20 %, specimens", "30 % incipient"])
@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_the_right_rotor_is_named(results, diagnoser, kind):
    faulty = of(results, diagnoser, kind)
    assert [r.named for r in faulty] == [r.flight.rotor for r in faulty] == [1, 2, 3, 4]
    assert not any(r.false_alarm for r in faulty)
    assert max(abs(r.mean_error) for r in faulty) < 0.02
    assert np.all(np.array([r.detection_delay for r in faulty]) < (1.5 if "incipient" in kind else 0.2))


@pytest.mark.xdist_group("bars")
@pytest.mark.parametrize("diagnoser", SENSITIVE)
def test_a_tenth_is_enough_to_name_the_rotor(results, diagnoser):
    faulty = of(results, diagnoser, "10 %")
    assert [r.named for r in faulty] == [1, 2, 3, 4]
    assert max(r.isolation_delay for r in faulty) < 0.6
