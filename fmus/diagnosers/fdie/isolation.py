"""Fault isolation estimators with adaptive thresholds (Avram, Zhang, Khalili, eqs. 26, 27 and 31)."""

from __future__ import annotations

from casadi import diag, fabs, fmax, fmin, repmat, reshape, sum1, vec, vertcat

from rotordx.fmus.diagnosers.fdie.model import Model
from rotordx.fmus.diagnosers.interface import any_of, hold_filter, latch
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports


@ports
class IsolationParameters:
    """Design choices of the four estimators, the same for each."""

    isolation_gain: Vector = port("1/s", "diagonal of Gamma_s in (26)", start=(8, 15, 15, 8), minimum=1e-3)
    learning_rate: Scalar = port("s2/rad2", "Psi_s in (27)", start=0.02, minimum=0)
    loe_max: Scalar = port("1", "largest loss considered: Theta = [0, loe_max]", start=0.5, minimum=1e-3, maximum=0.99)
    isolation_noise_floor: Vector = port(
        "m/s, rad/s", "added to the isolation thresholds: 4.5 sigma of the filtered noise", start=(0,) * 4, minimum=0
    )


@ports
class IsolationState:
    """Four estimators one after the other: element 4 s + j is channel j of estimator s."""

    isolation_residual: Vector = port("m/s, rad/s", "zeta - zeta_hat_s", start=(0,) * 16)
    isolation_bound: Vector = port("m/s, rad/s", "mu_s, without noise floor", start=(0,) * 16)
    fie_loe: Vector = port("1", "theta_hat_s of (27)", start=(0,) * 4)
    excluded: Vector = port("1", "1 once |isolation_residual| > mu_s in some channel (latched)", start=(0,) * 4)


def initial_isolation(parameters: IsolationParameters) -> IsolationState:
    """Estimators at detection: zeta_hat_s = measured zeta, wrong by its noise; theta_hat_s = the largest loss.

    theta_hat_s at detection decides what can be isolated, because in a mismatched estimator it falls towards 0 and
    with it kappa_s rises towards loe_max: from 0 a loss of 20 % is never isolated, from the largest 8 % still is.
    """
    return IsolationState(
        isolation_residual=0 * repmat(parameters.isolation_gain, 4, 1),
        isolation_bound=repmat(parameters.isolation_noise_floor, 4, 1),
        fie_loe=repmat(parameters.loe_max, 4, 1),
        excluded=0 * parameters.isolation_noise_floor,
    )


def advance_isolation(
    state: IsolationState, model: Model, parameters: IsolationParameters, dt: Scalar
) -> IsolationState:
    """Advance the four estimators over one step."""
    residual = reshape(state.isolation_residual, 4, 4)
    bound = reshape(state.isolation_bound, 4, 4)
    loe = state.fie_loe
    decay, gain = hold_filter(repmat(parameters.isolation_gain, 1, 4), dt)

    unexplained = repmat(model.zeta_rate - model.nominal, 1, 4) - model.signatures @ diag(loe)
    uncertainty = fabs(model.signatures) @ diag(loe_error_bound(loe, parameters.loe_max)) + repmat(model.bound, 1, 4)
    gradient = sum1(model.signatures * residual).T
    loe = project(loe + dt * parameters.learning_rate * gradient, parameters.loe_max)  # (27)
    residual = decay * residual + gain * unexplained  # (28)
    bound = decay * bound + gain * uncertainty  # (31)

    exceeds = fabs(residual) > bound + repmat(parameters.isolation_noise_floor, 1, 4)
    excluded = latch(state.excluded, vertcat(*(any_of(exceeds[:, s]) for s in range(4))))
    return IsolationState(vec(residual), vec(bound), loe, excluded)


def loe_error_bound(loe: Vector, loe_max: Scalar) -> Vector:
    """kappa_s of (31): largest |theta - theta_hat_s| over theta in Theta = [0, loe_max].

    It covers a loss that changes inside Theta as well, hence also the onset that motor lag and F smear.
    """
    return loe_max / 2 + fabs(loe - loe_max / 2)


def project(loe: Vector, loe_max: Scalar) -> Vector:
    """Projection on Theta = [0, loe_max] in (27)."""
    return fmin(fmax(loe, 0), loe_max)
