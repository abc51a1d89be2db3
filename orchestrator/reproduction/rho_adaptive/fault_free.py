"""J_nu against J_th in random fault-free runs of the attitude system: is the threshold of Theorem 1 safe, and tight?"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.reproduction.rho_adaptive.attitude_system import (
    INITIAL_ERROR,
    NOISE,
    UNCERTAINTY,
    Flights,
    simulate,
    tuned,
)

Array = NDArray[np.float64]

DURATION = 4.0  # s

#: what acts in a third of the runs each: (uncertainty, noise)
CASES = ((UNCERTAINTY, 0.0), (0.0, NOISE), (UNCERTAINTY, NOISE))


@dataclass(frozen=True)
class FaultFree:
    """Of each run."""

    ratio: Array  #: largest J_nu / J_th
    body_rate: Array  #: largest |omega_i|, rad/s: kappa_1 holds up to BODY_RATE


def fault_free_runs(count: int, seed: int, *, bounds_in_threshold: bool = True) -> FaultFree:
    """Fly healthy attitude systems with random motion, initial error, uncertainty and noise inside their bounds.

    Args:
        count: of runs.
        seed: of everything random.
        bounds_in_threshold: False: the negative control, whose threshold knows of no uncertainty and no noise.
    """
    rng = np.random.default_rng(seed)
    found = []
    for case, (uncertainty, noise) in enumerate(CASES):
        runs = len(range(case, count, len(CASES)))
        tuning = tuned(uncertainty, noise, INITIAL_ERROR)
        if not bounds_in_threshold:
            unaware = dataclasses.replace(tuning.evaluation, uncertainty_bound=0.0, noise_bound=0.0)
            tuning = dataclasses.replace(tuning, evaluation=unaware)
        found.append(simulate(_random(runs, rng, uncertainty, noise), tuning, DURATION))
    ratios = [(h.residual / h.threshold).max(axis=0) for h in found]
    return FaultFree(np.hstack(ratios), np.hstack([h.rate_norm.max(axis=0) for h in found]))


def _random(count: int, rng: np.random.Generator, uncertainty: float, noise: float) -> Flights:
    """Runs with uncertainty that is constant, or turns; noise near 200 rad/s; a quarter starts at the largest error."""
    direction, other = _unit(rng, count), _unit(rng, count)
    turning = rng.uniform(0.3, 20.0, (count, 1)) * (rng.random((count, 1)) < 0.5)
    rate, phase = rng.uniform(190, 400, (count, 3)), rng.uniform(0, 2 * np.pi, (count, 3))
    size = np.where(rng.random((count, 1)) < 0.25, 1.0, rng.random((count, 1)))

    def chi(time: float) -> Array:
        mixed = direction * np.cos(turning * time) + other * np.sin(turning * time)
        return np.asarray(uncertainty * mixed / np.maximum(1, np.linalg.norm(mixed, axis=1, keepdims=True)))

    return Flights(
        count=count,
        regressor=lambda torque: np.zeros(3),
        uncertainty=chi,
        noise=lambda time: noise / np.sqrt(3) * np.sin(rate * time + phase),
        initial_error=INITIAL_ERROR * size * _unit(rng, count),
        reference_phase=rng.uniform(0, 2 * np.pi, (count, 3)),
    )


def _unit(rng: np.random.Generator, count: int) -> Array:
    vectors = rng.normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
