"""The conditions that the papers print, solved as printed: none can hold, for the reason that the README gives."""

import cvxpy as cp
import numpy as np
import pytest

LIPSCHITZ = 0.3
N = 6


def smallest_largest_eigenvalue(matrix, constraints):
    """Smallest t for which matrix <= t I can be fulfilled."""
    t = cp.Variable()
    problem = cp.Problem(cp.Minimize(t), [matrix << t * np.eye(matrix.shape[0]), *constraints])
    problem.solve(solver=cp.CLARABEL)
    assert problem.status == cp.OPTIMAL
    return float(t.value)


def ren(lipschitz, performance):
    """Matrix of (32), or of (42) if `performance`, and its constraints, for Ren's vehicle with scaled faults."""
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [np.zeros((3, 6))]])
    B = np.vstack(
        (np.zeros((3, 4)), [[0, -14.347, 0, 14.347], [-14.347, 0, 14.347, 0], [1.366, -1.366, 1.366, -1.366]])
    )
    P, Q = cp.Variable((N, N), symmetric=True), cp.Variable((4, 4), symmetric=True)
    Y1, Y2 = cp.Variable((N, N)), cp.Variable((4, N))
    unit, gamma = (1.0 if performance else 0.0), 1.0
    omega = A.T @ P + P @ A - Y1 - Y1.T + (lipschitz**2 + unit) * np.eye(N)
    side = P @ B - Y2.T
    faults = (lipschitz**2 + unit) * np.eye(4)
    Z = np.zeros
    rows = [[omega, side, P, Z((N, 4))], [side.T, faults, Z((4, N)), Q]]
    rows += [[P, Z((N, 4)), -np.eye(N), Z((N, 4))], [Z((4, N)), Q, Z((4, N)), -np.eye(4)]]
    if performance:
        for i, block in enumerate(([P, Z((N, 4))], [Z((4, N)), Q], [Z((N, N)), Z((N, 4))], [Z((4, N)), Z((4, 4))])):
            rows[i] += block
        rows.append([P, Z((N, 4)), Z((N, N)), Z((N, 4)), -(gamma**2) * np.eye(N), Z((N, 4))])
        rows.append([Z((4, N)), Q, Z((4, N)), Z((4, 4)), Z((4, N)), -(gamma**2) * np.eye(4)])
    return cp.bmat(rows), [P >> 1e-6 * np.eye(N), Q >> 1e-6 * np.eye(4)]


@pytest.mark.parametrize("lipschitz", [0.3, 1.0])
def test_ren_32_has_a_largest_eigenvalue_of_the_squared_lipschitz_constant(lipschitz):
    assert smallest_largest_eigenvalue(*ren(lipschitz, performance=False)) == pytest.approx(lipschitz**2, abs=1e-4)


def test_ren_42_is_worse_by_the_performance_term():
    assert smallest_largest_eigenvalue(*ren(LIPSCHITZ, performance=True)) == pytest.approx(LIPSCHITZ**2 + 1, abs=1e-4)


def test_thau_17_asks_for_a_negative_positive_matrix():
    G = cp.Variable((3, 3), symmetric=True)
    sigma = 1.0
    smallest = smallest_largest_eigenvalue((sigma + 1) / sigma * G, [G >> 1e-3 * np.eye(3)])
    assert smallest == pytest.approx(2e-3, abs=1e-6)  # G > 0 and (sigma + 1) / sigma G < 0
    consistent = smallest_largest_eigenvalue(-2 * np.eye(3) + (sigma + 1) / sigma * G, [G >> 1e-3 * np.eye(3)])
    assert consistent == pytest.approx(-2 + 2e-3, abs=1e-6)  # the proof's own -2 I makes it possible, for small G only


def test_rho_modification_inequality_has_a_zero_on_its_diagonal_near_a_zero_estimate():
    # rho_s = 0 for |theta_hat| < N, and -rho_s I is a diagonal block: the largest eigenvalue is never below 0
    X = cp.Variable((3, 3), symmetric=True)
    rho = 0.0
    matrix = cp.bmat([[X, np.zeros((3, 4))], [np.zeros((4, 3)), -rho * np.eye(4)]])
    assert smallest_largest_eigenvalue(matrix, []) == pytest.approx(0, abs=1e-6)
