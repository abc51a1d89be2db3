"""Figures of an observer that need no optimisation: gain from disturbance to error, noise, settling, detectability."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from rotordx.gains.discretisation import input_matrix, step_matrix
from rotordx.gains.error_model import ClosedLoop, ErrorModel

Array = NDArray[np.float64]

#: State whose derivative the faults of an axis drive, and what else is judged with that axis; first one present counts.
AXES = {
    "roll": (("p",), ("roll", "p")),
    "pitch": (("q",), ("pitch", "q")),
    "yaw": (("r",), ("yaw", "r")),
    "vertical": (("v_z",), ("v_z",)),
}


def hinf_norm(A: Array, B: Array, C: Array, F: Array, tolerance: float = 1e-8) -> float:
    """Largest singular value over all frequencies of F + C (s I - A)^-1 B, A stable, by bisection.

    A bound g is too small exactly if the Hamiltonian matrix of the bounded real lemma has an eigenvalue on the
    imaginary axis (Boyd, Balakrishnan, Kabamba 1989).

    Args:
        A, B, C, F: (n, n), (n, m), (r, n), (r, m).
        tolerance: relative accuracy.
    """
    lower = float(max(np.linalg.norm(F, 2), np.linalg.norm(F - C @ np.linalg.solve(A, B), 2)))
    if lower == 0:
        lower = 1e-12
    upper = 2 * lower
    while not _is_bound(A, B, C, F, upper):
        lower, upper = upper, 2 * upper
    while upper - lower > tolerance * upper:
        middle = (lower + upper) / 2
        if _is_bound(A, B, C, F, middle):
            upper = middle
        else:
            lower = middle
    return float(upper)


def _is_bound(A: Array, B: Array, C: Array, F: Array, bound: float) -> bool:
    R = bound**2 * np.eye(F.shape[1]) - F.T @ F
    if np.linalg.eigvalsh(R)[0] <= 0:
        return False
    shifted = A + B @ np.linalg.solve(R, F.T @ C)
    weight = C.T @ (np.eye(len(C)) + F @ np.linalg.solve(R, F.T)) @ C
    hamiltonian = np.block([[shifted, B @ np.linalg.solve(R, B.T)], [-weight, -shifted.T]])
    eigenvalues = np.linalg.eigvals(hamiltonian)
    return bool(np.abs(eigenvalues.real).min() > 1e-9 * np.abs(eigenvalues).max())


def axis_outputs(model: ErrorModel) -> dict[str, Array]:
    """Rows that pick from z = W e what belongs to each axis: its angle, its rate, and the fault along it.

    The fault along an axis is the combination of faults that drives it, of unit length: for four rotors
    (1, -1, 1, -1)/2 is the one along yaw of a symmetrical X.
    """
    states = list(model.states)
    axes = {}
    for axis, (drivers, judged) in AXES.items():
        driver = next((states.index(name) for name in drivers if name in states), None)
        if driver is None:
            continue
        rows = [np.eye(len(states))[states.index(name)] for name in judged if name in states]
        along = np.zeros(len(states))
        along[model.faults] = model.A[0][driver, model.faults]
        if np.any(along):
            rows.append(along / np.linalg.norm(along))
        axes[axis] = np.array(rows)
    return axes


def noise_std(loop: ClosedLoop, disturbances: int, step_size: float, integrator: str) -> Array:
    """Standard deviation of the performance outputs z when each sample carries independent noise of size V.

    Args:
        loop: inputs w: first the disturbances, then the noise.
        disturbances: their number.
        step_size: time between samples, s.
        integrator: see `rotordx.gains.discretisation`.
    """
    S = step_matrix(loop.A, step_size, integrator)
    G = input_matrix(loop.A, loop.B[:, disturbances:], step_size, integrator)
    F = loop.F[:, disturbances:]
    covariance = solve_discrete_lyapunov(S, G @ G.T)
    return np.sqrt(np.diag(loop.C @ covariance @ loop.C.T + F @ F.T))


def settling_times(
    step: Array, outputs: Array, estimates: slice, step_size: float, within: float = 0.05
) -> list[float | None]:
    """Time, s, after which all outputs stay within a part of the one estimate that is wrong at first, for each one.

    Args:
        step: (n, n), e+ = step e.
        outputs: (k, n), what is looked at.
        estimates: states that are wrong at first, one after the other.
        step_size: s.
        within: the part.

    Returns:
        one time for each estimate, None if it is longer than 5 s.
    """
    errors = np.eye(len(step))[:, estimates]
    limit = within * np.abs(outputs @ errors).max(axis=0)
    last, count = np.zeros(errors.shape[1], dtype=int), round(5 / step_size)
    for k in range(1, count + 1):
        errors = step @ errors
        last[np.abs(outputs @ errors).max(axis=0) > limit] = k
    return [None if k == count else float(k + 1) * step_size for k in last]


def undetectable_directions(A: Array, C: Array, tolerance: float = 1e-9) -> Array:
    """Orthonormal states (columns) that no output shows and that do not decay, (n, 0) if there are none.

    Popov-Belevitch-Hautus: x with A x = s x, C x = 0 and Re s >= 0; here for real s, which suffices for faults.
    """
    scale = max(np.abs(A).max(), 1.0)
    found = []
    for eigenvalue in np.unique(np.round(np.linalg.eigvals(A).real, 9)):
        if eigenvalue >= -tolerance:
            pencil = np.vstack((A - eigenvalue * np.eye(len(A)), scale * C))
            _, singular_values, directions = np.linalg.svd(pencil)
            found.append(directions[singular_values < tolerance * scale])
    return np.vstack(found).T if found else np.zeros((len(A), 0))
