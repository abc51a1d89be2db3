"""The matrix inequalities behind the gains, each written once for every kind of number.

Each function returns a symmetric matrix that has to be positive definite. Its arguments are arrays of floats, arrays
of fractions (`rotordx.gains.exact`) or CVXPY expressions: the very text that is solved is also the one that is checked.
`P` weighs the estimation error e in the Lyapunov function V = e^T P e; `PA` stands for P A, where A is the matrix of
the error dynamics e' = A e + B w + D delta.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

Block = Callable[[Sequence[Sequence[Any]]], Any]


def identity(size: int) -> Any:
    """Unit matrix of integers, which spoil neither floats nor fractions."""
    return np.eye(size, dtype=int)


def zeros(rows: int, columns: int) -> Any:
    """Zero matrix of integers."""
    return np.zeros((rows, columns), dtype=int)


def bounded_real(
    P: Any,
    PA: Any,
    PB: Any,
    PD: Any,
    N: Any,
    C: Any,
    F: Any,
    *,
    lipschitz: Any,
    multiplier: Any,
    decay_rate: Any,
    squared_gain: Any,
    block: Block = np.block,
) -> Any:
    """-[PA + (PA)^T + 2 a P + m L^2 N^T N + C^T C, P D, P B + C^T F; *, -m I, 0; *, *, F^T F - g^2 I] > 0.

    Then V' + 2 a V + |z|^2 < g^2 |w|^2 for z = C e + F w and every nonlinearity |delta| <= L |N e|: without
    disturbance the error decays at least as exp(-a t), and the gain from w to z, in the sense of energy, is below g.

    Args:
        P, PA: (n, n).
        PB: (n, m), P times the input matrix of the disturbances w.
        PD: (n, d), P times the input matrix of the nonlinearity delta.
        N: (k, n), what the nonlinearity depends on.
        C, F: (r, n) and (r, m), performance output z.
        lipschitz: L.
        multiplier: m > 0 of the S-procedure, free.
        decay_rate: a, 1/s.
        squared_gain: g^2.
    """
    top = PA + PA.T + 2 * decay_rate * P + (multiplier * lipschitz**2) * (N.T @ N) + C.T @ C
    side = PB + C.T @ F
    disturbances, nonlinearities = side.shape[1], PD.shape[1]
    corner = zeros(nonlinearities, disturbances)
    return -1 * block(
        [
            [top, PD, side],
            [PD.T, -multiplier * identity(nonlinearities), corner],
            [side.T, corner.T, F.T @ F - squared_gain * identity(disturbances)],
        ]
    )


def disk(P: Any, PA: Any, *, radius: Any, block: Block = np.block) -> Any:
    """[q P, -(q P + PA); *, q P] > 0: all poles lie in the disk of radius q that touches 0 from the left.

    It bounds the gains, and an explicit Euler step of 1/q or less contracts V.
    """
    side = -1 * (radius * P + PA)
    return block([[radius * P, side], [side.T, radius * P]])


def contraction(P: Any, step: Any) -> Any:
    """P - S^T P S > 0: one step e -> S e of the discretised error dynamics makes V smaller."""
    return P - step.T @ P @ step


def noise_energy(P: Any, PLV: Any, slack: Any, *, block: Block = np.block) -> Any:
    """[W, (P L V)^T; *, P] >= 0: trace W bounds trace((L V)^T P (L V)), what measurement noise drives into V."""
    return block([[slack, PLV.T], [PLV, P]])


def covariance_bound(P: Any, transition: Any, gain: Any, measurement_noise: Any, process_noise: Any) -> Any:
    """P - (A P A^T + K R K^T + Q) > 0: P bounds the steady covariance of the one-step prediction error.

    Args:
        P: (n, n), bound on the covariance of the error e+ = A e + K v + w.
        transition: (n, n), A with the filter's correction inside.
        gain: (n, p), K with which the measurement noise v enters.
        measurement_noise, process_noise: (p, p) and (n, n), covariances R and Q.
    """
    return P - (transition @ P @ transition.T + gain @ measurement_noise @ gain.T + process_noise)


def disturbance_bound(
    P: Any,
    PA: Any,
    PLD: Any,
    multiplier: Any,
    uncertainty_weight: Any,
    noise_weight: Any,
    *,
    lipschitz: Any,
    decay_rate: Any,
    block: Block = np.block,
) -> Any:
    """-[PA + (PA)^T + 2 l P + t k^2 I, -P L D, P, P; *, -m_d I; *, *, -t I; *, *, *, -m_x I] > 0.

    Then V' + 2 l V < m_x |chi|^2 + m_d |d|^2 for e' = A e + chi + delta - L D d with |delta| <= k |e|.

    Args:
        P, PA: (n, n).
        PLD: (n, p), P L D.
        multiplier: t > 0 of the S-procedure, free.
        uncertainty_weight, noise_weight: m_x and m_d.
        lipschitz: k, 1/s.
        decay_rate: l, 1/s.
    """
    n, p = PLD.shape
    unit, none, aside = identity(n), zeros(n, n), zeros(p, n)
    top = PA + PA.T + 2 * decay_rate * P + (multiplier * lipschitz**2) * unit
    return -1 * block(
        [
            [top, -1 * PLD, P, P],
            [-1 * PLD.T, -noise_weight * identity(p), aside, aside],
            [P, aside.T, -multiplier * unit, none],
            [P, aside.T, none, -uncertainty_weight * unit],
        ]
    )
