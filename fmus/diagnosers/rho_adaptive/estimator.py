"""Observer with adaptive law and switching rho-modification (paper 003, Theorem 2), for any number of faults.

    x_hat' = A x_hat + B u + xi(x_hat, u) + phi theta_hat + P nu,    nu = y - x_hat    (C = D = I)
    theta_hat' = gamma phi^T Y nu - gamma rho_s theta_hat

gamma and the scale of Y are redundant. Here phi^T Y is the pseudo-inverse of phi: Y = (phi phi^T)^-1 for as many faults
as outputs, phi^T / |phi|^2 for one fault. phi theta_hat then follows gamma nu whatever the size of phi, and gamma, in
1/s2, is the squared natural frequency of the adaptation.
"""

from __future__ import annotations

from collections.abc import Callable

from casadi import adj, copysign, det, fabs, fmax, fmin, if_else, sqrt, sumsqr, vertcat

from rotordx.fmus.diagnosers.interface import runge_kutta
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports

#: A determinant closer to 0 than this is one of rotors that stand still; there is nothing to adapt then.
SINGULAR = 1e-9


@ports
class AdaptationParameters:
    """Design choices of the adaptive law."""

    learning_rate: Scalar = port("1/s2", "gamma", start=80.0, minimum=0)
    modification_rate: Scalar = port("1", "rho_0 of the switching modification", start=0.3, minimum=0)
    modification_norm: Scalar = port("1", "N: the modification acts on |theta_hat| above it", start=0.6, minimum=1e-3)


def switching_modification(fault: Vector, parameters: AdaptationParameters) -> Scalar:
    """rho_s of theta_hat: 0 if its norm is below N, rho_0 above 2 N, linear in between."""
    ratio = sqrt(fmax(1, sumsqr(fault) / parameters.modification_norm**2))  # differentiable at theta_hat = 0
    return parameters.modification_rate * fmin(1, ratio - 1)


def advance_estimator(
    state: Vector,
    fault: Vector,
    adapting: Scalar,
    measured: Callable[[float], Vector],
    acceleration: Callable[[Vector], Vector],
    regressor: Vector,
    weighted: Vector,
    gain: Vector,
    parameters: AdaptationParameters,
    dt: Scalar,
) -> tuple[Vector, Vector]:
    """(x_hat, theta_hat) after a step of the fourth-order Runge-Kutta method.

    Args:
        state: x_hat (n).
        fault: theta_hat (m).
        adapting: 1 if the adaptive law is active; theta_hat is held if it is 0.
        measured: y (n) after a share of the step.
        acceleration: A x + B u + xi(x, u) (n) of a state (n).
        regressor: phi (n, m).
        weighted: phi^T Y (m, n).
        gain: P (n, n).
    """
    size = state.numel()

    def derivative(value: Vector, share: float) -> Vector:
        x, theta = value[:size], value[size:]
        nu = measured(share) - x
        modification = switching_modification(theta, parameters)
        learning = adapting * parameters.learning_rate * (weighted @ nu - modification * theta)
        return vertcat(acceleration(x) + regressor @ theta + gain @ nu, learning)

    value = runge_kutta(derivative, vertcat(state, fault), dt)
    return value[:size], value[size:]


def inverse(regressor: Vector) -> Vector:
    """phi^T (phi phi^T)^-1 = phi^-1 of a square phi, 0 where there is none because all rotors stand still."""
    determinant = det(regressor)
    safe = if_else(fabs(determinant) < SINGULAR, copysign(SINGULAR, determinant), determinant)
    return adj(regressor) / safe
