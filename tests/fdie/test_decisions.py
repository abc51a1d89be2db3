"""What is detected stays detected, a rotor is named only when it alone is left, and every verdict has its time."""

import numpy as np
import pytest
from casadi import DM, SX, Function, vertcat
from hypothesis import given, settings
from hypothesis import strategies as st

from rotordx.fmus.diagnosers.fdie import naming
from rotordx.fmus.diagnosers.interface import Clock
from rotordx.fmus.model_terms.symbols import symbols
from rotordx.fmus.shell.ports import flatten, start_values
from tests.fdie.noisy_flights import FLIGHTS, NOISY, by_step, flown
from tests.fdie.world import DT, parameter_values

#: on one worker, because the flights are flown once for all tests
pytestmark = pytest.mark.xdist_group("fdie-decisions")


@pytest.fixture(scope="module")
def outputs(diagnoser):
    """Of the flights with a loss from 4 s on, by name, (steps, flight, ...)."""
    return by_step(diagnoser, flown(3500))


@pytest.mark.parametrize("name", ["fault_detected", "excluded", "set_excluded"])
def test_flags_are_latched(outputs, name):
    assert set(np.unique(outputs[name])) <= {0, 1}
    assert (np.diff(outputs[name], axis=0) >= 0).all()


@pytest.mark.parametrize("name", ["faulty_rotor", "paper_rotor", "set_rotor"])
def test_a_verdict_is_never_changed(outputs, name):
    for flight in outputs[name].T:
        assert len({verdict for verdict in flight if verdict != 0}) <= 1


@pytest.mark.parametrize(
    ("verdict", "time"),
    [
        ("fault_detected", "detection_time"),
        ("faulty_rotor", "isolation_time"),
        ("paper_rotor", "paper_isolation_time"),
        ("set_rotor", "set_isolation_time"),
    ],
)
def test_times_are_those_of_the_verdicts_and_nan_before(outputs, verdict, time):
    for i in range(len(FLIGHTS)):
        given = outputs[verdict][:, i] > 0  # no rotor is named by -1
        assert np.isnan(outputs[time][~given, i]).all()
        if given.any():
            np.testing.assert_array_equal(outputs[time][given, i], np.argmax(given) * DT)


def test_the_selected_rule_feeds_the_common_outputs(outputs):
    for i, (_, _, changes) in enumerate(FLIGHTS):
        rule = "paper" if changes.get("isolation_rule") == 0 else "set"
        np.testing.assert_array_equal(outputs["faulty_rotor"][:, i], outputs[f"{rule}_rotor"][:, i])
        np.testing.assert_array_equal(outputs["isolation_time"][:, i], outputs[f"{rule}_isolation_time"][:, i])


def test_the_estimate_is_given_to_the_named_rotor_only(outputs):
    for i in range(len(FLIGHTS)):
        named = outputs["faulty_rotor"][:, i, None] == np.arange(1, 5)
        assert (outputs["loe_estimate"][:, i][~named] == 0).all()
        assert (outputs["loe_estimate"][:, i][named] > 0).all()
        lower, upper = outputs["loe_lower"][:, i], outputs["loe_upper"][:, i]
        if (outputs["faulty_rotor"][:, i] > 0).any() and FLIGHTS[i][2].get("isolation_rule") != 0:
            estimate = outputs["loe_estimate"][:, i].sum(axis=1)
            assert ((lower <= estimate) & (estimate <= upper)).all()


def test_the_intervals_only_shrink_and_hold_the_loss(outputs):
    assert (np.diff(outputs["set_lower"], axis=0) >= 0).all()
    assert (np.diff(outputs["set_upper"], axis=0) <= 0).all()
    for i, (rotor, loss, changes) in enumerate(FLIGHTS):
        if 0 < loss <= changes.get("loe_max", 0.5):
            assert outputs["set_lower"][-1, i, rotor] <= loss <= outputs["set_upper"][-1, i, rotor]


def test_a_loss_beyond_theta_is_unknown(outputs):
    i = next(i for i, (_, loss, changes) in enumerate(FLIGHTS) if loss > changes.get("loe_max", 0.5))
    assert outputs["faulty_rotor"][-1, i] == -1
    assert (outputs["loe_estimate"][:, i] == 0).all()
    assert np.isnan(outputs["isolation_time"][-1, i])


def test_isolation_starts_from_the_largest_loss(outputs):
    """From 0, or half of it, the paper's rule isolates late or never (01-fdie)."""
    detected = int(np.argmax(outputs["fault_detected"][:, 0]))
    assert (outputs["fie_loe_estimate"][detected, 0] == parameter_values()["loe_max"]).all()
    assert (outputs["fie_loe_estimate"][:detected, 0] == 0).all()


def test_nothing_is_detected_while_warming_up(diagnoser):
    """Whatever the residual: here the bounds are those of no uncertainty at all."""
    nothing = {name: np.zeros(4) for name in NOISY if name.startswith("bound") or name.endswith("floor")}
    flights = [(0, 0.0, {**nothing, "warm_up_time": 0.4})]
    outputs = by_step(diagnoser, flown(400, flights), flights)
    assert outputs["detection_time"][-1, 0] == pytest.approx(0.4)


class Excluded:
    """Naming alone: verdicts (steps, rule) for excluded flags (steps, rotor, rule)."""

    def __init__(self):
        state_vector, state = symbols(naming.NamingState)
        before, now = SX.sym("before", 4, 2), SX.sym("now", 4, 2)
        time, dwell = SX.sym("time"), SX.sym("dwell")
        parameters = naming.NamingParameters(isolation_rule=1, dwell_time=dwell)
        after = naming.advance_naming(state, before, now, parameters, Clock(time, DT))
        outputs = [flatten(after, vertcat)]
        self.function = Function("naming", [state_vector, before, now, time, dwell], outputs)

    def __call__(self, flags, dwell):
        state, before, verdicts = DM(start_values(naming.NamingState)), np.zeros((4, 2)), []
        for k, now in enumerate(flags):
            state = self.function(state, before, now, k * DT, dwell)
            before = now
            verdicts.append(np.array(state).ravel()[2:4])
        return np.array(verdicts)


NAMING = Excluded()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(1, 30), min_size=4, max_size=4), st.integers(0, 12), st.integers(0, 23))
def test_naming_follows_the_order_of_exclusion(gaps, dwell_steps, order):
    """Rotors are excluded one after the other at any distances; the last one may follow within the dwell time."""
    rotors = np.random.default_rng(order).permutation(4)
    times = np.cumsum(gaps)
    steps = 60 + times[-1]
    flags = np.zeros((steps, 4, 2))
    for rotor, time in zip(rotors, times, strict=True):
        flags[time:, rotor] = 1
    verdicts = NAMING(flags, dwell_steps * DT)
    third, fourth = times[2], times[3]
    paper, by_sets = verdicts.T
    assert (paper[:third] == 0).all()
    assert (paper[third:] == rotors[3] + 1).all()
    if fourth - third <= dwell_steps:
        expected = np.where(np.arange(steps) < fourth, 0, -1)
    else:
        expected = np.where(np.arange(steps) < third + dwell_steps, 0, rotors[3] + 1)
    np.testing.assert_array_equal(by_sets, expected)


def test_four_rotors_excluded_at_once_is_unknown():
    flags = np.zeros((20, 4, 2))
    flags[5:] = 1
    verdicts = NAMING(flags, 0.02)
    assert (verdicts[:5] == 0).all()
    assert (verdicts[5:] == -1).all()
