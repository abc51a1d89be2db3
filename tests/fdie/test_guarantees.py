"""Where the paper's assumptions hold exactly, no threshold is ever crossed that must not be.

Over a thousand random flights with ideal sensors and any uncertainty inside its bound: |epsilon| <= epsilon_bar before
the fault, the estimator of the failed rotor stays below mu, set membership never excludes it, and its interval holds
the true loss.
"""

import numpy as np
import pytest

from tests.fdie.world import DT, IDEAL, Diagnosers, World

#: on one worker, because the flights are flown once for all tests
pytestmark = pytest.mark.xdist_group("fdie-guarantees")
FLIGHTS, STEPS = 1000, 1500  # 3 s; losses begin between 1 and 1.6 s


class Adversary:
    """Signs of the uncertainty, another pattern in each sixth of the flights."""

    def __init__(self, rng, flights, rotor):
        self.rng, self.flights, self.rotor = rng, flights, rotor
        self.pattern = np.arange(flights) % 6
        self.constant = rng.choice([-1.0, 1.0], (flights, 4))
        self.rate = rng.uniform(0.5, 30.0, (flights, 4))
        self.switched = self.constant.copy()

    def __call__(self, time, outputs):
        rows = np.arange(self.flights)
        matched = outputs["isolation_residual"].reshape(-1, 4, 4)[rows, self.rotor]
        flip = self.rng.random((self.flights, 4)) < 0.01
        self.switched = np.where(flip, -self.switched, self.switched)
        away = np.where(matched == 0, self.constant, np.sign(matched))
        patterns = [
            self.constant,
            self.switched,
            self.rng.uniform(-1, 1, (self.flights, 4)),
            np.sin(self.rate * time),
            away,  # always where the matched estimator is already wrong
            np.where(np.sin(self.rate * time) > 0, away, -away),
        ]
        return np.choose(self.pattern[:, None], patterns)


def fly(diagnoser, flights=FLIGHTS, steps=STEPS, seed=1):
    """Ratios residual over threshold that the theorems keep below one, and what was decided, per flight."""
    rng = np.random.default_rng(seed)
    rotor = rng.integers(0, 4, flights)
    loss = rng.uniform(0.0, 0.5, flights)
    onset = np.where(np.arange(flights) % 10 == 0, np.inf, np.round(rng.uniform(1.0, 1.6, flights) / DT) * DT)
    world = World(flights, seed, onset, rotor, loss)
    diagnosers = Diagnosers(flights, diagnoser, **IDEAL)
    outputs = diagnosers.sample(0.0, world.command, world.euler, world.zeta)
    adversary = Adversary(rng, flights, rotor)
    rows = np.arange(flights)
    detection, isolation = np.zeros(flights), np.zeros(flights)
    escaped = np.zeros(flights, bool)
    for _ in range(steps):
        world.advance(adversary(world.time, outputs))
        outputs = diagnosers.sample(world.time, world.command, world.euler, world.zeta)
        healthy = world.time <= onset + DT / 2
        ratio = np.max(abs(outputs["residual"]) / outputs["threshold"], axis=1)
        detection[healthy] = np.maximum(detection, ratio)[healthy]
        matched = (outputs["fault_detected"] > 0) & ~healthy
        after = matched & (world.time > outputs["detection_time"] + DT / 2)  # at detection both are zero
        pair = [outputs[name].reshape(-1, 4, 4)[rows, rotor] for name in ("isolation_residual", "isolation_threshold")]
        isolation[after] = np.maximum(isolation, np.max(abs(pair[0]) / np.maximum(pair[1], 1e-300), axis=1))[after]
        lower, upper = (outputs[name][rows, rotor] for name in ("set_lower", "set_upper"))
        escaped |= matched & ((lower > loss) | (loss > upper))
    detected = outputs["fault_detected"] > 0
    return {
        "detection_ratio": detection,
        "isolation_ratio": isolation,
        "escaped": escaped,
        "alarm_when_healthy": detected & ~(outputs["detection_time"] > onset),
        "detected": detected,
        "paper_excludes_truth": detected & (outputs["excluded"][rows, rotor] > 0),
        "set_excludes_truth": detected & (outputs["set_excluded"][rows, rotor] > 0),
        "wrong": (outputs["faulty_rotor"] != 0) & (outputs["faulty_rotor"] != rotor + 1),
        "named": outputs["faulty_rotor"] == rotor + 1,
        "named_by_paper": outputs["paper_rotor"] == rotor + 1,
        "paper_wrong": (outputs["paper_rotor"] != 0) & (outputs["paper_rotor"] != rotor + 1),
    }


@pytest.fixture(scope="module")
def flights(diagnoser):
    return fly(diagnoser)


def test_the_flights_test_something(flights):
    assert flights["detected"].sum() > FLIGHTS / 2
    assert flights["named"].sum() > FLIGHTS / 3
    assert flights["named_by_paper"].sum() > FLIGHTS / 10
    assert flights["detection_ratio"].max() > 0.95  # the adversary comes close
    assert flights["isolation_ratio"].max() > 0.8


def test_no_alarm_while_the_uncertainty_is_inside_its_bound(flights):
    assert flights["detection_ratio"].max() <= 1
    assert not flights["alarm_when_healthy"].any()


def test_the_estimator_of_the_failed_rotor_never_crosses_its_threshold(flights):
    assert flights["isolation_ratio"].max() <= 1
    assert not flights["paper_excludes_truth"].any()


def test_set_membership_never_loses_the_truth(flights):
    assert not flights["escaped"].any()
    assert not flights["set_excludes_truth"].any()


def test_no_rotor_is_named_wrongly(flights):
    assert not flights["wrong"].any()
    assert not flights["paper_wrong"].any()
