"""The symbolic filters applied to numpy systems: symmetric matrices packed and unpacked, states kept between steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tests.kalman.textbook import Array, System

#: a CasADi function or its compiled form: arrays in, a list of arrays out
Step = Callable[..., Sequence[Any]]


def packed(matrix: Array) -> Array:
    """Upper triangle by columns."""
    return np.concatenate([matrix[: j + 1, j] for j in range(len(matrix))])


def unpacked(values: Array) -> Array:
    """The symmetric matrix that `packed` was given."""
    n = round((np.sqrt(8 * len(values) + 1) - 1) / 2)
    matrix = np.zeros((n, n), values.dtype)
    matrix[np.tril_indices(n)] = values
    return matrix + np.tril(matrix, -1).T


def model_arguments(system: System) -> list[Array]:
    """Of the functions in `_filter_costs`: A, b, E, C, packed Q, diagonals of Q_gamma and R."""
    s = system
    return [s.A, s.b, s.E, s.C, packed(s.Q), np.diag(s.Q_gamma), np.diag(s.R)]


def flat(values: Any) -> Array:
    """A CasADi matrix or an array as a flat array, by columns."""
    return np.asarray(values).ravel(order="F")


class AugmentedFilter:
    """`kalman.augmented_step` from a prior."""

    def __init__(self, step: Step, X: Array, P: Array):
        self._step, self.X, self._P = step, X.copy(), packed(P)

    def step(self, system: System, y: Array) -> None:
        self.X, self._P, self.innovation = map(flat, self._step(self.X, self._P, *model_arguments(system), y))

    @property
    def covariance(self) -> Array:
        return unpacked(self._P)


class StagedFilter:
    """`kalman.staged_step` from a prior, states and losses correlated: V0 = P_xg P_gg^-1."""

    def __init__(self, step: Step, X: Array, P: Array, n: int):
        V = P[:n, n:] @ np.linalg.inv(P[n:, n:])
        gamma, P_gamma = X[n:], P[n:, n:]
        self._step, self._n = step, n
        self._state = [X[:n] - V @ gamma, packed(P[:n, :n] - V @ P_gamma @ V.T), gamma, packed(P_gamma), V]

    def step(self, system: System, y: Array, *fixed: Array) -> None:
        *state, self.innovation = map(flat, self._step(*self._state, *model_arguments(system), y, *fixed))
        state[4] = state[4].reshape((self._n, -1), order="F")
        self._state = state

    @property
    def X(self) -> Array:
        x, _, gamma, _, V = self._state
        return np.concatenate([x + V @ gamma, gamma])

    @property
    def covariance(self) -> Array:
        _, P, _, P_gamma, V = self._state
        cross = V @ unpacked(P_gamma)
        return np.block([[unpacked(P) + cross @ V.T, cross], [cross.T, unpacked(P_gamma)]])
