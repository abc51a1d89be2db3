"""Both filters are the Kalman filter of states and losses, in double and in single precision, whatever the system."""

from functools import cache

import numpy as np
import pytest

from rotordx.fmus.diagnosers import kalman
from rotordx.orchestrator.reproduction.msjfo import filter_costs as forms
from tests.kalman.packing import AugmentedFilter, StagedFilter
from tests.kalman.textbook import Filter, RandomSystem, TwoStage
from tests.mutation import mutate

STEPS = 1000
#: (n, m, p) and variance of the losses' walk per step
SYSTEMS = [(size, variance) for size in ((3, 1, 3), (8, 4, 4), (12, 4, 12)) for variance in (0.0, 1e-4, 1e-2)]
SYSTEMS += [((3, 1, 1), 1e-4), ((4, 4, 4), 1e-4), ((12, 4, 6), 1e-4)]


@cache
def augmented(*size):
    return forms.augmented(*size)


@cache
def staged(*size):
    return forms.staged(*size)


def largest_difference(filters, size, loss_variance, seed, steps=STEPS):
    """Largest deviation of estimates and covariances of filters from the textbook's, and mean normalised innovation."""
    n, _, p = size
    system = RandomSystem(*size, loss_variance, seed)
    X, P = system.prior()
    assert np.diag(P)[n:].max() <= 10 + 1e-9
    assert np.abs(P[:n, n:]).max() > 0.01
    reference = Filter(X.copy(), P.copy())
    others = [make(X, P) for make in filters]
    worst, innovations, innovation_error = np.zeros(len(others)), [], 0.0
    for k in range(steps):
        matrices, y = system.advance(k)
        reference.step(matrices, y)
        innovations.append(reference.innovation_squared / p)
        for i, other in enumerate(others):
            other.step(matrices, y)
            error = max(np.abs(other.X - reference.X).max(), np.abs(other.covariance - reference.P).max())
            worst[i] = max(worst[i], error)
            if hasattr(other, "innovation"):
                squared = float(np.sum(np.square(other.innovation)))
                innovation_error = max(innovation_error, abs(squared - reference.innovation_squared))
    return worst, np.mean(innovations), innovation_error


@pytest.mark.parametrize(("size", "loss_variance"), SYSTEMS, ids=str)
def test_multi_stage_and_augmented_filter_are_the_textbook_filter(size, loss_variance):
    filters = [
        lambda X, P: AugmentedFilter(augmented(*size), X, P),
        lambda X, P: StagedFilter(staged(*size), X, P, size[0]),
        lambda X, P: TwoStage.start(X, P, size[0]),
    ]
    worst, _, innovation_error = largest_difference(filters, size, loss_variance, seed=1)
    assert worst.max() < 1e-9
    assert innovation_error < 1e-9  # one measurement after the other, or all at once


@pytest.mark.parametrize(
    ("function", "size", "tolerance"),
    [(forms.augmented, (8, 4, 4), 1e-4), (forms.staged, (8, 4, 4), 1e-4), (forms.staged, (3, 1, 3), 1e-5)],
)
def test_single_precision_follows(function, size, tolerance, tmp_path):
    compiled = forms.Compiled(function(*size), tmp_path, np.float32, "-O0")
    make = (
        (lambda X, P: AugmentedFilter(compiled, X, P))
        if function is forms.augmented
        else (lambda X, P: StagedFilter(compiled, X, P, size[0]))
    )
    worst, _, _ = largest_difference([make], size, 1e-4, seed=2)
    assert worst[0] < tolerance


@pytest.mark.parametrize("size", [(3, 1, 3), (8, 4, 4), (12, 4, 6)], ids=str)
@pytest.mark.parametrize("loss_variance", [1e-4, 1e-2])
def test_innovations_are_as_large_as_the_covariance_says(size, loss_variance):
    means = [largest_difference([], size, loss_variance, seed, steps=2000)[1] for seed in range(3)]
    assert 0.95 <= np.mean(means) <= 1.05


MUTANTS = {
    "no mean correction": (" + correction @ before.loss\n", "\n"),
    "no covariance correction": ("        + correction @ before.loss_covariance @ W.T\n", ""),
    "plain Friedland": ("correction = W @ _solved(loss_covariance, model.loss_noise).T", "correction = 0 * W"),
}


@pytest.mark.parametrize("loss_variance", [1e-4, 1e-2])
@pytest.mark.parametrize("name", MUTANTS)
def test_without_its_corrections_the_multi_stage_filter_is_another(name, loss_variance, monkeypatch):
    mutate(monkeypatch, kalman.staged_step, *MUTANTS[name])
    step = forms.staged(8, 4, 4)
    worst, _, _ = largest_difference(
        [lambda X, P: StagedFilter(step, X, P, 8)], (8, 4, 4), loss_variance, seed=1, steps=300
    )
    assert worst[0] > 1e-3


@pytest.mark.parametrize("loss_variance", [1e-4, 1e-2])
@pytest.mark.parametrize(
    "variant",
    [
        {"mean_correction": False},
        {"covariance_correction": False},
        {"mean_correction": False, "covariance_correction": False, "friedland": True},
    ],
    ids=MUTANTS,
)
def test_so_is_the_printed_one(variant, loss_variance):
    worst, _, _ = largest_difference(
        [lambda X, P: TwoStage.start(X, P, 8, **variant)], (8, 4, 4), loss_variance, seed=1, steps=300
    )
    assert worst[0] > 1e-3


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        (kalman.augmented_step, "SX.eye(m)]])", "0.999 * SX.eye(m)]])"),
        (kalman.augmented_step, "joint + gain * error", "joint - gain * error"),
        (kalman._scalar_gain, "+ noise_variance", "+ 2 * noise_variance"),
        (kalman._mirrored, "triu2symm(triu(matrix))", "triu2symm(triu(1.001 * matrix))"),
        (kalman._loss_stage, "before.loss_covariance - gain", "before.loss_covariance + gain"),
        (kalman._scalar_stage, "before.coupling - gain @ H", "before.coupling + gain @ H"),
    ],
)
def test_mistakes_in_the_filters_are_seen(function, old, new, monkeypatch):
    mutate(monkeypatch, function, old, new)
    joint, stages = forms.augmented(3, 1, 3), forms.staged(3, 1, 3)
    filters = [lambda X, P: AugmentedFilter(joint, X, P), lambda X, P: StagedFilter(stages, X, P, 3)]
    worst, _, _ = largest_difference(filters, (3, 1, 3), 1e-2, seed=1, steps=50)
    assert worst.max() > 1e-6


def test_a_fixed_gain_is_nearly_as_good_where_the_model_stands_still():
    """Friedland's filter with the steady bias-free gain, against the optimal one, after the start."""
    n, m, p = 8, 4, 4
    system = RandomSystem(n, m, p, 1e-6, 3)
    for change in ("A_change", "C_change"):
        setattr(system, change, 0 * getattr(system, change))
    X, P = system.prior(0.1)
    optimal = StagedFilter(staged(n, m, p), X, P, n)
    fixed = StagedFilter(forms.staged(n, m, p, fixed_gain=True), X, P, n)
    A, C, Q, R = system.A, system.C, system.Q, system.R
    covariance = np.eye(n)
    for _ in range(500):
        covariance = A @ covariance @ A.T + Q
        S = C @ covariance @ C.T + R
        K = covariance @ C.T @ np.linalg.inv(S)
        covariance = covariance - K @ C @ covariance
    # the losses' stage takes one residual after the other: it needs measurements whose innovations are independent
    rotation = np.linalg.eigh(S)[1]
    errors = np.zeros((2, 1500))
    for k in range(1500):
        matrices, y = system.advance(k)
        truth = system.gamma
        optimal.step(matrices, y)
        matrices.C, matrices.R = rotation.T @ C, rotation.T @ R @ rotation
        fixed.step(matrices, rotation.T @ y, K @ rotation, np.diag(rotation.T @ S @ rotation))
        errors[:, k] = [np.sqrt(np.mean((f.X[n:] - truth) ** 2)) for f in (optimal, fixed)]
    optimal_error, fixed_error = errors[:, 500:].mean(axis=1)
    assert fixed_error <= 1.02 * optimal_error
