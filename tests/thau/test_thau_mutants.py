"""Mistakes that a glance does not find are seen by the checks of this folder: each mutant is killed by a named one."""

import numpy as np
import pytest

from rotordx.fmus.diagnosers import attitude_observer as observer
from rotordx.fmus.diagnosers import interface
from rotordx.fmus.diagnosers.adaptive_thau import adaptation
from rotordx.fmus.diagnosers.asmto import step as asmto
from rotordx.fmus.diagnosers.thau import step as thau
from rotordx.fmus.model_terms import terms
from tests.mutation import mutate
from tests.thau import test_continuous_observer, test_observer_properties


def follows_the_continuous_observer(diagnoser):
    return test_continuous_observer.deviation(diagnoser, 0.002) < test_continuous_observer.TOLERANCE[diagnoser]


def test_nothing_mutated_follows_the_continuous_observer():
    assert all(map(follows_the_continuous_observer, test_continuous_observer.PARAMETERS))


@pytest.mark.parametrize(
    ("diagnoser", "function", "old", "new"),
    [
        pytest.param("thau", thau.step, "- gain @ error", "+ gain @ error", id="sign-of-K-thau"),
        pytest.param(
            "adaptive_thau",
            adaptation.derivative,
            "- rows(parameters.observer_gain, 6) @ error",
            "+ rows(parameters.observer_gain, 6) @ error",
            id="sign-of-K",
        ),
        pytest.param("thau", interface.rows, ").T", ")", id="K-by-columns"),
        pytest.param(
            "thau", terms.coupling_torque, "vertcat(0, 0, rotor_momentum)", "vertcat(0, 0, 0)", id="no-gyroscopic-term"
        ),
        pytest.param(
            "thau", terms.coupling_torque, "-vehicle.rotor_inertia", "vehicle.rotor_inertia", id="momentum-sign"
        ),
        pytest.param(
            "adaptive_thau",
            adaptation.derivative,
            "fault / vehicle.inertia",
            "fault[[1, 0, 2]] / vehicle.inertia",
            id="rows-of-B-swapped",
        ),
        pytest.param(
            "adaptive_thau", adaptation.derivative, "fault / vehicle.inertia", "fault", id="B-without-inertia"
        ),
        pytest.param(
            "adaptive_thau", adaptation.derivative, "+ parameters.leak", "- parameters.leak", id="sign-of-leak"
        ),
        pytest.param(
            "adaptive_thau",
            adaptation.derivative,
            "-parameters.learning_rate",
            "parameters.learning_rate",
            id="sign-of-F2",
        ),
        pytest.param("asmto", asmto.sliding_term, "return -gain", "return gain", id="sign-of-sliding-term"),
        pytest.param("asmto", asmto.gain_rate, "- parameters.dead_zone, 0)", ", 0)", id="no-dead-zone"),
        pytest.param("asmto", asmto.gain_rate, "- parameters.sliding_leak * gain", "", id="no-leak-of-n"),
        pytest.param("thau", interface.runge_kutta, "first + 2 * second", "first + second", id="runge-kutta-weight"),
        pytest.param(
            "thau", observer.interval, "continued(estimate, before)", "continued(estimate, measurement)", id="y-held"
        ),
        pytest.param(
            "thau",
            observer.interval,
            "speed_before=speed_before",
            "speed_before=command.rotor_speed_command",
            id="commanded-speed-for-turning-speed",
        ),
        pytest.param(
            "thau",
            interface.lagged_speed,
            "if_else(started, previous, command.rotor_speed_command)",
            "previous",
            id="rotors-start-at-rest",
        ),
    ],
)
def test_mutants_do_not_follow_the_continuous_observer(monkeypatch, diagnoser, function, old, new):
    mutate(monkeypatch, function, old, new)
    assert not follows_the_continuous_observer(diagnoser)


@pytest.mark.parametrize(
    ("function", "old", "new", "check"),
    [
        pytest.param(
            observer.continued,
            "wrapped(measurement[:3] - estimate[:3])",
            "measurement[:3] - estimate[:3]",
            test_observer_properties.test_yaw_may_jump_by_a_turn,
            id="no-wrapping",
        ),
        pytest.param(
            observer.observer_outputs,
            "vehicle.inertia * fault[1:]",
            "fault[1:]",
            lambda diagnoser: test_observer_properties.test_an_unknown_constant_torque_is_read(diagnoser, 0),
            id="torque-without-inertia",
        ),
        pytest.param(
            observer.observer_outputs,
            "-verdict.loe_estimate",
            "verdict.loe_estimate",
            lambda diagnoser: test_observer_properties.test_the_lost_thrust_of_a_named_rotor_is_in_newtons(
                diagnoser, 2
            ),
            id="offset-sign",
        ),
    ],
)
@pytest.mark.parametrize("diagnoser", ["thau", "adaptive_thau"])
def test_mutants_break_what_holds_in_any_flight(monkeypatch, diagnoser, function, old, new, check):
    mutate(monkeypatch, function, old, new)
    with np.errstate(all="ignore"), pytest.raises(AssertionError):
        check(diagnoser)


def test_without_its_own_margin_the_fast_residual_is_no_use(monkeypatch):
    mutate(monkeypatch, thau.step, "any_of(fabs(fast_deviation) > parameters.fast_margin)", "0")
    with pytest.raises(AssertionError):
        test_observer_properties.test_thau_sees_large_faults_at_once_and_small_ones_after_a_while()
