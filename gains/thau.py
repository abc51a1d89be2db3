"""Gains of `thau`: Thau observer of attitude and body rates (Nguyen, Hong 2018, section 3.1, Lemma 1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_lyapunov
from scipy.stats import norm

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains import fault_models, margins
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ObserverGain
from rotordx.gains.fault_models import ObserverOptions
from rotordx.gains.observer_theory import OBSERVER, prove
from rotordx.gains.options import POSITIVE, DesignError, option
from rotordx.gains.rounding import rounded, rounded_rows
from rotordx.gains.theory import Certificate, Subject

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Options(ObserverOptions):
    """Options of the design."""

    speed: float = option(1.0, "1", "faster (above 1) or quieter (below 1): multiplies epsilon", minimum=POSITIVE)
    epsilon: float = option(
        100.0, "1/s", "of Lemma 1: the observer's poles lie near -epsilon; 100 gives the printed K", minimum=POSITIVE
    )
    disturbance: float = option(1.0, "rad/s2", "weight of unknown angular accelerations in w", minimum=POSITIVE)
    filter_bandwidth: float = option(
        10.0,
        "rad/s",
        "of the low-pass behind the sensitive residual: what it lets through is its noise",
        minimum=POSITIVE,
    )
    false_alarm_time: float = option(
        3.6e5, "s", "mean time between samples at which noise alone exceeds its part of the fast margin", minimum=1.0
    )


def thau_gain(A: Array, C: Array, epsilon: float) -> Array:
    """K = P^-1 C^T of Lemma 1, with A^T P + P A - C^T C + epsilon P = 0 ((10), where epsilon C^T P is a misprint).

    Raises:
        DesignError: if (A, C) is not observable.
    """
    shifted = A + epsilon / 2 * np.eye(len(A))
    P = solve_continuous_lyapunov(shifted.T, C.T @ C)
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError as error:
        raise DesignError(
            f"Lemma 1 has no positive definite solution for epsilon = {epsilon:g}; take a larger one"
        ) from error
    return np.linalg.solve(P, C.T)


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Gain by Lemma 1 with the Lipschitz condition that the lemma omits, and a margin for each of the two residuals.

    Raises:
        DesignError: if the observer is unstable at the step, or the Lipschitz constant too large for it.
    """
    model = fault_models.attitude(vehicle, options, options.disturbance)
    epsilon = options.epsilon * options.speed
    parameters: dict[str, Any] = {
        "observer_gain": rounded_rows(thau_gain(model.A[0], model.C, epsilon)).flatten(),
        "filter_bandwidth": options.filter_bandwidth,
    }
    subject = subjects(vehicle, options, parameters)["attitude"]
    half = epsilon / 4  # half of the decay that Lemma 1 has without nonlinearity
    proof = prove(subject, half, options, "a shorter step or a lower speed")
    parameters |= decision_parameters(vehicle, options, parameters)
    return new_design("thau", vehicle, options, parameters, [Certificate.of("attitude", subject, proof)])


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margins of both residuals. All channels rise alike, on the way up as with a smaller loss: none has to settle."""
    filtered = margins.margin("thau", vehicle, parameters, "filtered_acceleration_fault", options)
    fast = margins.margin("thau", vehicle, parameters, "acceleration_fault", fast_options(options))
    return {"margin": filtered["margin"], "settling_time": np.zeros(4), "fast_margin": fast["margin"]}


def fast_options(options: Options) -> Options:
    """The noise multiple for three residuals that are as good as new at every sample: exceeded once in a long while."""
    share = options.step_size / options.false_alarm_time / len(fault_models.RATES) / 2
    return replace(options, noise_multiple=rounded(float(norm.isf(share)), 4))


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design."""
    model = fault_models.attitude(vehicle, options, options.disturbance)
    gain = np.array(parameters["observer_gain"], dtype=float).reshape(6, 6)
    return {"attitude": Subject(OBSERVER, model, ObserverGain.of(gain))}
