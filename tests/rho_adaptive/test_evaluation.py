"""J_nu is the rms of nu over the last T1, and never above J_th while nu is within its bound."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rotordx.fmus.diagnosers.rho_adaptive import evaluation
from rotordx.fmus.diagnosers.rho_adaptive.evaluation import (
    SLOTS,
    EvaluationParameters,
    EvaluationState,
    evaluate,
    residual_bound,
)
from rotordx.fmus.shell.ports import flatten, size, start_values, table, unflatten
from tests.mutation import mutate

BOUNDS = {"overshoot": 1.2, "decay_rate": 15.0, "lipschitz": 2.0, "gain_norm": 16.0, "uncertainty_bound": 1.1}
BOUNDS |= {"noise_bound": 0.02, "noise_rms": 1e-6, "noise_projection": 1e-6, "initial_error": 0.3}


def parameters(**changes) -> EvaluationParameters:
    return EvaluationParameters(**({p.name: p.start[0] for p in table(EvaluationParameters)} | BOUNDS | changes))


def history(residuals, dt: float, running=None, **changes) -> tuple[np.ndarray, np.ndarray]:
    """J_nu and J_th after each of some residuals (steps, 3)."""
    x, nu, on = ca.SX.sym("x", size(EvaluationState)), ca.SX.sym("nu", 3), ca.SX.sym("on")
    state, *values = evaluate(nu, on, unflatten(EvaluationState, x), parameters(**changes), dt)
    step = ca.Function("evaluate", [x, nu, on], [flatten(state, ca.vertcat), ca.vertcat(*values)])
    running = np.ones(len(residuals)) if running is None else running
    state, found = ca.DM(start_values(EvaluationState)), []
    for residual, flag in zip(np.asarray(residuals), running, strict=True):
        state, both = step(state, residual, flag)
        found.append(both.full().ravel())
    return tuple(np.array(found).T)


@pytest.mark.parametrize("dt", [0.002, 0.0025, 0.004])
def test_a_constant_residual_is_its_own_rms_once_the_window_is_full(dt):
    steps = round(0.8 / dt)
    found, _ = history(np.tile([0.1, -0.2, 0.2], (steps, 1)), dt)
    full = round(0.2 / dt) + 2
    # slots close at the next sample, by which each is up to half a sample too long or too short
    tolerance = 1e-12 if (0.2 / SLOTS / dt).is_integer() else dt / 2 / 0.2
    np.testing.assert_allclose(found[full:], 0.3, rtol=tolerance)
    assert np.all(found[: round(0.1 / dt)] < 0.3 * np.sqrt(0.52))
    assert np.all(np.diff(found[: round(0.18 / dt)]) > 0)


@pytest.mark.parametrize("dt", [0.002, 0.0025, 0.004])
def test_the_ring_is_a_sliding_window_up_to_one_slot(dt):
    time = dt * np.arange(round(3 / dt))
    residuals = np.column_stack([np.sin(4 * time), 0.5 * np.cos(7 * time), 0.2 * np.sin(time)])
    found, _ = history(residuals, dt)
    power, window = np.sum(residuals**2, axis=1), round(0.2 / dt)
    exact = np.sqrt(np.convolve(power, np.ones(window) / window)[: len(power)])
    assert np.max(np.abs(found - exact)[window + 5 :]) < 0.02 * exact.max()


def test_what_is_older_than_the_window_is_forgotten():
    residuals = np.zeros((250, 3))
    residuals[10] = 5.0
    found, _ = history(residuals, 0.002)
    assert found[109] > 0
    assert not found[10 + 106 :].any()


def test_nothing_is_evaluated_before_it_is_running():
    running = np.arange(400) >= 200
    residuals = np.random.default_rng(1).normal(size=(400, 3))
    late = history(residuals, 0.002, running)
    anew = history(residuals[200:], 0.002)
    np.testing.assert_array_equal(late[0][200:], anew[0])
    np.testing.assert_array_equal(late[1][200:], anew[1])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.002, 0.0025, 0.004, 0.02]), st.floats(0.05, 0.5))
def test_residuals_within_the_bound_never_cross_the_threshold(seed, dt, window):
    found, threshold = history(_worst(seed, 300, dt), dt, window=window)
    assert np.all(found <= threshold)
    assert np.max(found / threshold) > 0.5  # which is no empty promise


def test_constant_residuals_at_the_bound_reach_the_threshold():
    time = 0.002 * np.arange(1000)
    found, threshold = history(np.outer(_bound(time), [0.6, 0.0, 0.8]), 0.002)
    np.testing.assert_allclose(found, threshold, atol=2e-6)


def test_random_noise_adds_to_the_bound_as_its_quantiles_say():
    """J_th^2 = S^2 + 2 S c + Q^2, less than (S + Q)^2: noise hardly ever points where the residual does."""
    alone = history(np.zeros((300, 3)), 0.002, noise_rms=0.0, noise_projection=0.0)[1]
    both = history(np.zeros((300, 3)), 0.002, noise_rms=0.05, noise_projection=0.02)[1]
    np.testing.assert_allclose(both, np.sqrt(alone**2 + 2 * 0.02 * alone + 0.05**2), rtol=1e-12)


def test_the_bound_solves_the_comparison_equation_of_the_theorem():
    """|e|' <= -(b - alpha kappa_1) |e| + alpha (chi + |P| d) from alpha epsilon, and |nu| <= |e| + d."""
    p = parameters()
    rate, driven = p.decay_rate - p.overshoot * p.lipschitz, p.uncertainty_bound + p.gain_norm * p.noise_bound
    times = np.linspace(0, 0.5, 20)
    solution = solve_ivp(
        lambda _, e: -rate * e + p.overshoot * driven,
        (0, 0.5),
        [p.overshoot * p.initial_error],
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    )
    expected = solution.y[0] + p.noise_bound
    np.testing.assert_allclose([residual_bound(np.exp(-rate * t), p) for t in times], expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        pytest.param(evaluation.residual_bound, "parameters.gain_norm * parameters.noise_bound", "0", id="no-P-d"),
        pytest.param(evaluation.residual_bound, "(initial - steady) * transient", "0", id="no-initial-error"),
        pytest.param(evaluation.residual_bound, " + parameters.noise_bound", "", id="no-D-d"),
        pytest.param(evaluation.residual_bound, "parameters.overshoot * driven / margin", "driven", id="no-decay"),
        pytest.param(evaluation.residual_bound, "parameters.overshoot * driven", "driven", id="no-overshoot"),
    ],
)
def test_other_bounds_are_not_that_of_the_theorem(monkeypatch, function, old, new):
    mutate(monkeypatch, function, old, new)
    monkeypatch.setitem(globals(), "residual_bound", evaluation.residual_bound)
    with pytest.raises(AssertionError):
        test_the_bound_solves_the_comparison_equation_of_the_theorem()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param("(1 - share) * slots[SLOTS]", "share * slots[SLOTS]", id="the-oldest-slot-grows"),
        pytest.param("vertcat(0, newest, slots[1:SLOTS])", "vertcat(newest, slots[1:])", id="nothing-forgotten"),
        pytest.param("range(1, SLOTS)", "range(2, SLOTS)", id="a-slot-too-few"),
    ],
)
def test_other_rings_are_no_sliding_window(monkeypatch, old, new):
    mutate(monkeypatch, evaluation.evaluate, old, new)
    monkeypatch.setitem(globals(), "evaluate", evaluation.evaluate)
    with pytest.raises(AssertionError):
        test_the_ring_is_a_sliding_window_up_to_one_slot(0.002)


def _bound(time: np.ndarray) -> np.ndarray:
    p = parameters()
    rate = p.decay_rate - p.overshoot * p.lipschitz
    return np.array([residual_bound(np.exp(-rate * t), p) for t in time])


def _worst(seed: int, steps: int, dt: float) -> np.ndarray:
    """Residuals of random directions, at their bound or below it for a while."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(steps, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    share = np.repeat(rng.random(steps // 20 + 1) < 0.8, 20)[:steps]
    return directions * (share * _bound(dt * np.arange(steps)))[:, None]
