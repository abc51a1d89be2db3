"""One step of an observer as it runs on a computer: x' = A x + B u, u held over the step."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.gains.inequalities import identity
from rotordx.gains.options import DesignError

#: Number of terms of the exponential series that a Runge-Kutta method of this name keeps.
ORDERS = {"euler": 1, "heun": 2, "rk4": 4}

INTEGRATORS = (*ORDERS, "exact")


def step_matrix(A: Any, step_size: Any, integrator: str) -> Any:
    """S of x+ = S x + G u. Of floats or, save for the integrator `exact`, of fractions."""
    if integrator == "exact":
        from scipy.linalg import expm

        return expm(step_size * A)
    result = term = identity(len(A))
    for k in range(1, ORDERS[integrator] + 1):
        term = term @ A * step_size / k
        result = result + term
    return result


def input_matrix(
    A: NDArray[np.float64], B: NDArray[np.float64], step_size: float, integrator: str
) -> NDArray[np.float64]:
    """G of x+ = S x + G u: the step of the system [A B; 0 0], upper right block."""
    n, m = B.shape
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A, B
    return np.asarray(step_matrix(whole, step_size, integrator)[:n, n:])


def spectral_radius(matrix: NDArray[np.float64]) -> float:
    """Largest absolute value of the eigenvalues."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def require_stable(A: NDArray[np.float64], step_size: float, integrator: str, remedy: str) -> float:
    """Spectral radius of one step.

    Raises:
        DesignError: if it is 1 or more; `remedy` completes the sentence "take ...".
    """
    radius = spectral_radius(step_matrix(A, step_size, integrator))
    if radius >= 1:
        name = {"euler": "explicit Euler", "heun": "Heun's method", "rk4": "RK4", "exact": "exact discretisation"}
        raise DesignError(
            f"the observer is unstable when it runs with {name[integrator]} at a step of {step_size * 1e3:g} ms "
            f"(spectral radius {radius:.4f}); take {remedy}"
        )
    return radius
