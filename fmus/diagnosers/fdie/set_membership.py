"""Set-membership isolation: the losses of each rotor that the measurements since detection allow.

An extension of the paper's rule on the same assumption (16). A detection estimator restarted at detection and not
adapted obeys e = loss (H_s - S) + E with |E| <= e_bar, where H_s is the signature through the estimator's own filter
and S, between 0 and S_s, what motor lag and velocity filter still carry of the time before the fault. Every channel at
every time thus confines the loss of rotor s to an interval; a rotor whose intervals have nothing in common is
excluded. Nothing is given away to kappa_s of (31), and what is left is an interval for the loss; weighted least squares
on the same signals give a value in it long before (27) has come down from the largest loss, where it must start.

It holds while the vehicle is upright (the signatures keep their signs) and the loss is constant after detection.
"""

from __future__ import annotations

from functools import reduce
from math import inf

from casadi import SX, exp, fabs, fmax, fmin, if_else, repmat, reshape, sign, sum1, vec, vertsplit

from rotordx.fmus.diagnosers.fdie.model import Model
from rotordx.fmus.diagnosers.interface import hold_filter, latch
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports

#: A filtered signature smaller than this (m/s or rad/s per unit of loss) says nothing.
NEGLIGIBLE = 1e-9


@ports
class SetParameters:
    """Design choices of set membership."""

    estimate_memory_time: Scalar = port(
        "s", "time constant with which the least-squares estimate forgets", start=2.0, minimum=1e-3
    )


@ports
class SetState:
    """Restarted detection estimator, filtered signatures (element 4 s + j: rotor s, channel j), intervals."""

    set_residual: Vector = port("m/s, rad/s", "e", start=(0,) * 4)
    set_bound: Vector = port("m/s, rad/s", "e_bar, without noise floor", start=(0,) * 4)
    set_signature: Vector = port("m/s, rad/s", "H_s", start=(0,) * 16)
    set_remembered: Vector = port("m/s, rad/s", "S_s", start=(0,) * 16)
    set_lower: Vector = port("1", "smallest loss of each rotor that is left", start=(0,) * 4)
    set_upper: Vector = port("1", "largest loss of each rotor that is left", start=(0,) * 4)
    set_excluded: Vector = port("1", "1 if no loss is left (latched)", start=(0,) * 4)
    set_evidence: Vector = port("1", "weighted sum of H_s e, by channels and time", start=(0,) * 4)
    set_information: Vector = port("1", "weighted sum of H_s^2", start=(0,) * 4)


def initial_set(noise_floor: Vector, loe_max: Scalar) -> SetState:
    """Set at detection: the estimator starts from the measured zeta, wrong by its noise; every loss is possible."""
    nothing, matrix = SX.zeros(4), SX.zeros(16)
    return SetState(nothing, noise_floor, matrix, matrix, nothing, nothing + loe_max, nothing, nothing, nothing)


def advance_set(
    state: SetState, model: Model, observer_gain: Vector, noise_floor: Vector, parameters: SetParameters, dt: Scalar
) -> SetState:
    """Advance the estimator over one step, cut the intervals with what the new sample allows, update the estimate."""
    decay, gain = hold_filter(observer_gain, dt)
    residual = decay * state.set_residual + gain * (model.zeta_rate - model.nominal)
    bound = decay * state.set_bound + gain * model.bound
    decay, gain = repmat(decay, 1, 4), repmat(gain, 1, 4)
    signature = decay * reshape(state.set_signature, 4, 4) + gain * model.signatures
    remembered = decay * reshape(state.set_remembered, 4, 4) + gain * model.remembered

    least, most = allowed_loss(residual, bound + noise_floor, signature, remembered)
    lower = fmax(state.set_lower, if_else(state.set_excluded, -inf, reduce(fmax, vertsplit(least)).T))
    upper = fmin(state.set_upper, if_else(state.set_excluded, inf, reduce(fmin, vertsplit(most)).T))
    excluded = latch(state.set_excluded, lower > upper)

    weight = 1 / (bound + noise_floor + NEGLIGIBLE)
    expected = (signature - remembered / 2) * repmat(weight, 1, 4)
    forget = exp(-dt / parameters.estimate_memory_time)
    evidence = forget * state.set_evidence + expected.T @ (residual * weight)
    information = forget * state.set_information + sum1(expected**2).T
    return SetState(residual, bound, vec(signature), vec(remembered), lower, upper, excluded, evidence, information)


def allowed_loss(residual: Vector, bound: Vector, signature: Vector, remembered: Vector) -> tuple[Vector, Vector]:
    """Smallest and largest loss of each rotor (column) that each channel (row) allows; infinite if it says nothing.

    From e = loss (H - S) + E, |E| <= bound and 0 <= S <= S_s: loss H >= e - bound and loss (H - S_s) <= e + bound.
    """
    towards_loss = repmat(residual, 1, 4) * sign(signature)
    bound = repmat(bound, 1, 4)
    full = fabs(signature)
    certain = full - fabs(remembered)
    least = if_else(full > NEGLIGIBLE, (towards_loss - bound) / full, -inf)
    most = if_else(certain > NEGLIGIBLE, (towards_loss + bound) / certain, inf)
    return least, most


def estimated_loss(state: SetState) -> Vector:
    """Loss of each rotor (4) by least squares over channels and time, weights 1 / bound^2, cut to its interval.

    The half of S_s that is subtracted from H_s is the middle of what may be missing. A rotor whose interval is empty,
    because its loss changes for example, has nothing to be cut to.
    """
    estimate = state.set_evidence / fmax(state.set_information, NEGLIGIBLE)
    return if_else(state.set_excluded, estimate, fmin(fmax(estimate, state.set_lower), state.set_upper))
