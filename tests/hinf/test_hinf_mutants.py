"""Mistakes that a glance does not find are seen by the checks of this folder: each mutant is killed by a named one."""

import pytest

from rotordx.fmus.diagnosers.fast_adaptive import step as fast_adaptive
from rotordx.fmus.diagnosers.hinf import observer
from rotordx.fmus.diagnosers.hinf import step as hinf
from rotordx.fmus.model_terms import terms
from tests.hinf import test_discretisation, test_hinf_verdicts
from tests.mutation import mutate


def follows_the_continuous_observer(name):
    return test_discretisation.deviation(name, 0.002) < test_discretisation.TOLERANCE


def test_nothing_mutated_follows_the_continuous_observers():
    assert all(map(follows_the_continuous_observer, test_discretisation.PARAMETERS))


@pytest.mark.parametrize(
    ("name", "function", "old", "new"),
    [
        pytest.param(
            "vz4", observer.advance_observer, "vertcat(y, v_z) - z[:7]", "z[:7] - vertcat(y, v_z)", id="sign-of-L"
        ),
        pytest.param(
            "vz4", observer.advance_observer, "injection[9:] / effort", "-injection[9:] / effort", id="sign-of-K"
        ),
        pytest.param("vz4", observer.advance_observer, "injection[9:] / effort", "injection[9:]", id="K-unscaled"),
        pytest.param("vz4", observer.advance_observer, "euler_rate(euler, body_rate)", "body_rate", id="no-R-eta"),
        pytest.param(
            "vz4",
            observer.advance_observer,
            "share * (measured.vertical_velocity - velocity_before)",
            "0",
            id="v_z-held",
        ),
        pytest.param("vz4", observer.fault_input, "-hover", "hover", id="sign-of-B"),
        pytest.param("vz4", observer.fault_input, "-hover", "-hover[[0, 2, 1, 3], :]", id="rows-of-B-swapped"),
        pytest.param("vz4", observer.fault_input, "-hover", "-hover[:, [1, 0, 2, 3]]", id="rotors-swapped"),
        pytest.param("tau3", observer.fault_input, "(1, 2, 3)", "(2, 1, 3)", id="torques-swapped"),
        pytest.param("vz4", observer.fault_effort, ") ** 2", ")", id="speed-for-squared-speed"),
        pytest.param("vz4", observer._vertical_rate, "v_z - filtered", "filtered - v_z", id="filter-lag-sign"),
        pytest.param(
            "vz4", observer._vertical_rate, "2 * bandwidth * filtered", "bandwidth * filtered", id="filter-damping"
        ),
        pytest.param("vz4", observer._vertical_rate, "acceleration + drag", "acceleration", id="no-drag"),
        pytest.param("tau3", observer._embedded, "gain[6:, :]", "-gain[6:, :]", id="sign-of-K-tau3"),
        pytest.param(
            "vz4", terms.coupling_torque, "vertcat(0, 0, rotor_momentum)", "vertcat(0, 0, 0)", id="no-gyroscopic-term"
        ),
        pytest.param("vz4", terms.input_gain, "cos(euler[0]) * cos(euler[1])", "cos(euler[0])", id="one-cos"),
        pytest.param("fast_adaptive", fast_adaptive.step, "- L @ error", "+ L @ error", id="sign-of-L-fast"),
        pytest.param("fast_adaptive", fast_adaptive.step, "return -parameters", "return parameters", id="sign-of-F"),
        pytest.param(
            "fast_adaptive", fast_adaptive.step, "parameters.integral_rate * integral", "integral", id="no-sigma"
        ),
        pytest.param(
            "fast_adaptive", fast_adaptive.step, "vertcat(y[:3], estimate[3:])", "estimate", id="attitude-estimated"
        ),
    ],
)
def test_mutants_do_not_follow_the_continuous_observers(monkeypatch, name, function, old, new):
    mutate(monkeypatch, function, old, new)
    assert not follows_the_continuous_observer(name)


@pytest.mark.parametrize(
    ("old", "new", "check"),
    [
        pytest.param(
            "margin=if_else(four, parameters.margin, parameters.torque_margin)",
            "margin=parameters.margin",
            test_hinf_verdicts.test_thresholds_are_those_of_the_model,
            id="margin-of-the-other-model",
        ),
        pytest.param(
            "vertcat(four * estimate.signatures[0, :]",
            "vertcat(estimate.signatures[0, :]",
            test_hinf_verdicts.test_tau3_names_a_rotor_without_the_vertical_velocity,
            id="tau3-expects-v_z",
        ),
        pytest.param(
            "solve(estimate.signatures, deviation)",
            "-deviation",
            test_hinf_verdicts.test_vz4_estimates_several_losses_at_once,
            id="accelerations-for-losses",
        ),
        pytest.param(
            "if_else(others > 0, each, verdict.loe_estimate)",
            "verdict.loe_estimate",
            test_hinf_verdicts.test_vz4_estimates_several_losses_at_once,
            id="only-the-named-rotor",
        ),
    ],
)
def test_mutants_break_the_verdict(monkeypatch, old, new, check):
    mutate(monkeypatch, hinf.step, old, new)
    with pytest.raises(AssertionError):
        check()


def test_without_patience_a_transient_flags_healthy_rotors(monkeypatch):
    mutate(monkeypatch, hinf._judged, "> settling_time + clock.dt / 2", "> -1")
    with pytest.raises(AssertionError):
        test_hinf_verdicts.test_one_loss_flags_no_other_rotor()
