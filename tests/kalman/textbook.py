"""Kalman filters in plain numpy, from textbook equations: nothing packed, nothing sparse, measurements all at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]


@dataclass
class System:
    """One step of x+ = A x + b + E gamma + w, y+ = C x+ + v, with full covariances."""

    A: Array
    b: Array
    E: Array
    C: Array
    Q: Array
    Q_gamma: Array
    R: Array


@dataclass
class Filter:
    """Kalman filter of X = [x; gamma]."""

    X: Array
    P: Array
    innovation_squared: float = np.nan  #: normalised, of all p measurements

    def step(self, system: System, y: Array) -> None:
        n, m = system.E.shape
        F = np.block([[system.A, system.E], [np.zeros((m, n)), np.eye(m)]])
        H = np.hstack([system.C, np.zeros((len(y), m))])
        Q = np.block([[system.Q, np.zeros((n, m))], [np.zeros((m, n)), system.Q_gamma]])
        X = F @ self.X + np.concatenate([system.b, np.zeros(m)])
        P = F @ self.P @ F.T + Q
        S = H @ P @ H.T + system.R
        K = P @ H.T @ np.linalg.inv(S)
        innovation = y - H @ X
        self.X = X + K @ innovation
        self.P = (np.eye(n + m) - K @ H) @ P
        self.P = (self.P + self.P.T) / 2
        self.innovation_squared = float(innovation @ np.linalg.solve(S, innovation))


@dataclass
class TwoStage:
    """Optimal two-stage filter (Hsieh, Chen 1999), as the paper prints it, with the signs corrected.

    `mean_correction`, `covariance_correction` False leave out what couples the stages; both False, and V+ = W, is
    Friedland's filter.
    """

    x: Array  #: bias-free
    P: Array
    gamma: Array
    P_gamma: Array
    V: Array
    mean_correction: bool = True
    covariance_correction: bool = True
    friedland: bool = False

    @classmethod
    def start(cls, X: Array, P: Array, n: int, **variant: bool) -> TwoStage:
        V = P[:n, n:] @ np.linalg.inv(P[n:, n:])
        return cls(X[:n] - V @ X[n:], P[:n, :n] - V @ P[n:, n:] @ V.T, X[n:].copy(), P[n:, n:].copy(), V, **variant)

    def step(self, system: System, y: Array) -> None:
        A, C, R = system.A, system.C, system.R
        W = A @ self.V + system.E
        P_gamma = self.P_gamma + system.Q_gamma
        V = W if self.friedland else W @ self.P_gamma @ np.linalg.inv(P_gamma)
        x = A @ self.x + system.b
        P = A @ self.P @ A.T + system.Q
        if self.mean_correction:
            x = x + W @ self.gamma - V @ self.gamma
        if self.covariance_correction:
            P = P + W @ self.P_gamma @ W.T - V @ P_gamma @ V.T
        r = y - C @ x
        S = C @ P @ C.T + R
        K = P @ C.T @ np.linalg.inv(S)
        H = C @ V
        K_gamma = P_gamma @ H.T @ np.linalg.inv(H @ P_gamma @ H.T + S)
        self.x = x + K @ r
        self.P = (np.eye(len(x)) - K @ C) @ P
        self.P = (self.P + self.P.T) / 2
        self.gamma = self.gamma + K_gamma @ (r - H @ self.gamma)
        self.P_gamma = P_gamma - K_gamma @ H @ P_gamma
        self.P_gamma = (self.P_gamma + self.P_gamma.T) / 2
        self.V = V - K @ H

    @property
    def X(self) -> Array:
        return np.concatenate([self.x + self.V @ self.gamma, self.gamma])

    @property
    def covariance(self) -> Array:
        cross = self.V @ self.P_gamma
        return np.block([[self.P + cross @ self.V.T, cross], [cross.T, self.P_gamma]])


@dataclass
class RandomSystem:
    """A stable linear system whose matrices move with time, with losses that walk at random."""

    n: int
    m: int
    p: int
    loss_variance: float
    seed: int

    def __post_init__(self):
        self.rng = rng = np.random.default_rng(self.seed)
        n, m, p = self.n, self.m, self.p
        A = rng.normal(size=(n, n))
        self.A = 0.8 * A / np.linalg.norm(A, 2)
        self.A_change = 0.05 * rng.normal(size=(n, n)) / np.sqrt(n)
        self.B, self.B_change = rng.normal(size=(n, m)), 0.3 * rng.normal(size=(n, m))
        self.C, self.C_change = rng.normal(size=(p, n)), 0.3 * rng.normal(size=(p, n))
        self.Q = self._covariance(n, 0.01)
        self.Q_gamma = self.loss_variance * np.eye(m)
        self.R = np.diag(0.1 * rng.uniform(0.5, 2.0, p))
        self.x, self.gamma = rng.normal(size=n), 0.3 * rng.uniform(size=m)
        self._root = np.linalg.cholesky(self.Q)

    def _covariance(self, size: int, scale: float) -> Array:
        root = self.rng.normal(size=(size, size))
        return scale * (root @ root.T / size + 0.1 * np.eye(size))

    def prior(self, loss_variance: float = 10.0) -> tuple[Array, Array]:
        """Estimate and covariance at the start, states and losses correlated; the truth is drawn from it."""
        size = self.n + self.m
        scale = np.sqrt(np.concatenate([np.ones(self.n), np.full(self.m, loss_variance)]))
        P = self._covariance(size, 1.0) * np.outer(scale, scale)
        P *= np.minimum(1, loss_variance / np.diag(P)[self.n :].max())
        truth = np.concatenate([self.x, self.gamma])
        return truth + np.linalg.cholesky(P) @ self.rng.normal(size=size), P

    def advance(self, k: int) -> tuple[System, Array]:
        """System of step k and what is measured at its end."""
        rng, n, m, p = self.rng, self.n, self.m, self.p
        A = self.A + self.A_change * np.sin(0.01 * k * np.arange(1, n + 1))
        B = self.B + self.B_change * np.cos(0.017 * k)
        C = self.C + self.C_change * np.sin(0.013 * k)
        u = 1 + np.sin(0.05 * k * np.arange(1, m + 1)) + 0.3 * rng.normal(size=m)
        system = System(A, B @ u, -B * u, C, self.Q, self.Q_gamma, self.R)
        self.x = A @ self.x + B @ u - B @ (u * self.gamma) + self._root @ rng.normal(size=n)
        self.gamma = self.gamma + np.sqrt(self.loss_variance) * rng.normal(size=m)
        return system, C @ self.x + np.sqrt(np.diag(self.R)) * rng.normal(size=p)
