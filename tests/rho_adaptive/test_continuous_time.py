"""A discrete step is its differential equation up to the square of the step, and mistakes in it are seen."""

import pytest

from rotordx.fmus.diagnosers.interface import lagged_speed
from rotordx.fmus.diagnosers.known_acceleration import known_acceleration
from rotordx.fmus.diagnosers.rho_adaptive import estimator
from rotordx.fmus.diagnosers.smo import step as sliding
from rotordx.fmus.model_terms import terms
from tests.mutation import mutate
from tests.rho_adaptive.continuous import deviation

DIAGNOSERS = ("rho_adaptive", "smo")
#: of a step of 4 ms, relative
SMALL = 3e-4


@pytest.mark.parametrize("name", DIAGNOSERS)
def test_halving_the_step_quarters_the_deviation(name):
    coarse, middle, fine = (deviation(name, dt) for dt in (0.004, 0.002, 0.001))
    assert coarse < SMALL
    assert 3.7 < coarse / middle < 4.3
    assert 3.7 < middle / fine < 4.3


@pytest.mark.parametrize("dt", [0.002, 0.0025, 0.004])
@pytest.mark.parametrize("name", DIAGNOSERS)
def test_every_step_size_in_use_is_stable(name, dt):
    assert deviation(name, dt) < SMALL * (dt / 0.004) ** 2 * 1.5


@pytest.mark.parametrize("name", DIAGNOSERS)
@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        pytest.param(terms.rate_dynamics, "coupling_torque(", "0 * coupling_torque(", id="no-gyroscopic-torque"),
        pytest.param(terms.coupling_torque, "-cross(", "cross(", id="sign-of-gyroscopic-torque"),
        pytest.param(known_acceleration, "vertical_lag=sum2(", "vertical_lag=0 * sum2(", id="thrust-not-matched"),
        pytest.param(lagged_speed, "motor_lag(before, ", "(lambda a, *_: a)(", id="no-lag"),
        pytest.param(known_acceleration, "after=channels", "after=state.channels", id="measurement-late"),
    ],
)
def test_a_wrong_model_is_not_the_differential_equation(monkeypatch, name, function, old, new):
    mutate(monkeypatch, function, old, new)
    assert not deviation(name, 0.004) < 10 * SMALL  # or not a number: it diverges


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        pytest.param(terms.fault_signatures, "-input_gain", "input_gain", id="sign-of-signatures"),
        pytest.param(known_acceleration, "(filtered, ", "(unmatched[0, :], ", id="signatures-not-matched"),
        pytest.param(estimator.advance_estimator, "+ gain @ nu", "- gain @ nu", id="sign-of-P"),
        pytest.param(estimator.advance_estimator, "regressor @ theta +", "", id="theta-not-in-the-observer"),
        pytest.param(estimator.advance_estimator, "weighted @ nu", "regressor.T @ nu", id="Y-not-weighted"),
        pytest.param(estimator.advance_estimator, "- modification * theta", "+ modification * theta", id="sign-of-rho"),
        pytest.param(estimator.switching_modification, "ratio - 1", "ratio", id="rho-without-dead-zone"),
        pytest.param(estimator.switching_modification, "fmin(1, ratio - 1)", "0 * ratio", id="no-modification"),
        pytest.param(estimator.inverse, "adj(regressor)", "adj(regressor).T", id="inverse-transposed"),
    ],
)
def test_a_wrong_adaptive_law_is_not_the_differential_equation(monkeypatch, function, old, new):
    mutate(monkeypatch, function, old, new)
    assert not deviation("rho_adaptive", 0.004) < 10 * SMALL


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        pytest.param(sliding.injection, "parameters.sliding_gain * saturated", "0 * saturated", id="no-sliding-term"),
        pytest.param(sliding.injection, "fmax(-1, fmin(1, error", "fmax(-9, fmin(9, error", id="not-saturated"),
        pytest.param(sliding.injection, "parameters.linear_gain * error", "-parameters.linear_gain * error", id="sign"),
        pytest.param(sliding.advance_observer, "(v - z)", "v", id="filter-without-decay"),
    ],
)
def test_a_wrong_sliding_term_is_not_the_differential_equation(monkeypatch, function, old, new):
    mutate(monkeypatch, function, old, new)
    assert not deviation("smo", 0.004) < 10 * SMALL
