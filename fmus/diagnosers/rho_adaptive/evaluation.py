"""Residual evaluation over a causal window, and its threshold (paper 003, Theorem 1).

    J_nu(t) = (1/T1 integral of nu^T nu over the last T1)^1/2,    s = alpha (chi + |P| d) / (b - alpha kappa_1),
    |nu| <= s + (alpha epsilon - s) e^{-(b - alpha kappa_1) t} + d    (C = D = I)

The paper prints the integral over t ... t + T1, which nobody knows at t, and without 1/T1, which makes J_nu an rms
value in the units of nu and changes no verdict. The window is a short ring of slots in the state: the newest one fills
while the oldest one fades, so that the window always weighs T1. |nu|^2 and its bound pass through the same ring;
whatever the weights are, J_nu <= J_th follows from |nu| <= bound.

Noise whose amplitude counts is d. Random noise n enters the window as a whole instead: of nu = s + n, with S the rms
value of the bound on s, J_nu^2 = |s|^2 + 2 <s, n> + |n|^2 <= S^2 + 2 S noise_projection + noise_rms^2, where the two
are quantiles (gains/window_noise.py). Without random noise they are equal, and a floor above rounding errors.
"""

from __future__ import annotations

from casadi import exp, fmax, fmin, if_else, sqrt, sumsqr, vertcat

from rotordx.fmus.shell.ports import Scalar, Vector, port, ports

#: Slots of a full window; the ring has one more, which fades.
SLOTS = 20


@ports
class EvaluationParameters:
    """Constants of Theorem 1 (gains/rho_adaptive.py)."""

    window: Scalar = port("s", "T1", start=0.2, minimum=1e-3)
    overshoot: Scalar = port("1", "alpha: |exp((A - P) t)| <= alpha exp(-b t)", start=1.0, minimum=1)
    decay_rate: Scalar = port("1/s", "b", start=18.0, minimum=1e-3)
    lipschitz: Scalar = port("1/s", "kappa_1 of xi; alpha kappa_1 < b", start=2.5, minimum=0)
    gain_norm: Scalar = port("1/s", "|P|, the largest singular value of observer_gain", start=18.0, minimum=0)
    uncertainty_bound: Scalar = port("m/s2, rad/s2", "chi: bound on the norm of the uncertainty", 1.5, minimum=0)
    noise_bound: Scalar = port("m/s, rad/s", "d: bound on the norm of the noise, if its amplitude counts", 0, minimum=0)
    noise_rms: Scalar = port("m/s, rad/s", "quantile of what random noise leaves in J_nu", start=1e-3, minimum=0)
    noise_projection: Scalar = port(
        "m/s, rad/s", "quantile of the random noise along the part of nu that is not random", start=1e-3, minimum=0
    )
    initial_error: Scalar = port("m/s, rad/s", "epsilon: bound on the norm of the initial error", 0.1, minimum=0)


@ports
class EvaluationState:
    """Ring of slots, newest first: integrals over each slot."""

    residual_slots: Vector = port("rad2/s", "integral of |nu|^2", start=(0,) * (SLOTS + 1))
    bound_slots: Vector = port("rad2/s", "integral of its squared bound", start=(0,) * (SLOTS + 1))
    slot_age: Scalar = port("s", "time since the newest slot was opened")
    transient: Scalar = port("1", "e^{-(b - alpha kappa_1) t}", start=1.0)


def residual_bound(transient: Scalar, parameters: EvaluationParameters) -> Scalar:
    """Bound on |nu| by Theorem 1; `transient` is its exponential."""
    margin = parameters.decay_rate - parameters.overshoot * parameters.lipschitz
    driven = parameters.uncertainty_bound + parameters.gain_norm * parameters.noise_bound
    steady = parameters.overshoot * driven / margin
    initial = parameters.overshoot * parameters.initial_error
    return steady + (initial - steady) * transient + parameters.noise_bound


def evaluate(
    residual: Vector, running: Scalar, state: EvaluationState, parameters: EvaluationParameters, dt: Scalar
) -> tuple[EvaluationState, Scalar, Scalar]:
    """Advance the window by one sample.

    Args:
        residual: nu (n).
        running: 1 if the evaluation is running; while it is 0 the window stays empty and the transient at its start.

    Returns:
        state, J_nu and J_th in the units of nu.
    """
    margin = parameters.decay_rate - parameters.overshoot * parameters.lipschitz
    transient = if_else(running, exp(-margin * dt) * state.transient, 1)
    length = parameters.window / SLOTS
    age = state.slot_age + running * dt
    share = fmax(0, fmin(1, age / length))
    full = age > length - dt / 2

    totals, rings = [], []
    bound = residual_bound(state.transient, parameters)
    for slots, value in ((state.residual_slots, sumsqr(residual)), (state.bound_slots, bound**2)):
        newest = slots[0] + running * dt * value
        totals.append(newest + sum(slots[i] for i in range(1, SLOTS)) + (1 - share) * slots[SLOTS])
        rings.append(if_else(full, vertcat(0, newest, slots[1:SLOTS]), vertcat(newest, slots[1:])))
    advanced = EvaluationState(rings[0], rings[1], if_else(full, fmin(age - length, length), age), transient)
    residual_rms, bound_rms = (sqrt(total / parameters.window) for total in totals)
    crossed = 2 * bound_rms * parameters.noise_projection
    return advanced, residual_rms, sqrt(bound_rms**2 + crossed + parameters.noise_rms**2)
