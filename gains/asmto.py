"""Gains of `asmto`: adaptive sliding mode Thau observer (Nguyen, Hong 2018, (13), (14), (20)).

The observer of `adaptive_thau` with the sliding term E_d v, v = -n sat(F1 (y_hat - y) / boundary_layer), whose gain n
grows with |F1 (y_hat - y)| beyond a dead zone, leaks, and is limited. F1 = E_d^T P, P = p I, exactly (18) for C = I.
Within the boundary layer the term is linear, E_d (n / boundary_layer) F1, so that the observer moves between the gains
for n = 0 and for the largest n: one certificate holds for both. The pure sign of the paper is the limit of a vanishing
boundary layer, whose discrete step is unstable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains import fault_models, margins
from rotordx.gains.adaptive_thau import Options as AdaptiveThauOptions
from rotordx.gains.adaptive_thau import augmented_gain, leaking, thau_parameters
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ObserverGain
from rotordx.gains.observer_theory import OBSERVER, prove
from rotordx.gains.options import option
from rotordx.gains.rounding import rounded
from rotordx.gains.theory import Certificate, Subject

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Options(AdaptiveThauOptions):
    """Options of the design."""

    disturbance_direction: tuple[float, float, float, float, float, float] = option(
        (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
        "1",
        "E_d; the paper's six ones also drive the angles, which no disturbance does",
        minimum=-1.0,
    )
    sliding_gain_max: float = option(1.0, "rad/s2", "largest n, the disturbance that the sliding term can cancel")
    sliding_rate: float = option(0.1, "rad/s3", "alpha of (14): growth of n per unit of |F1 e_y| outside the dead zone")
    sliding_leak: float = option(0.1, "1/s", "leak of n, which lets it return")


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Closed-form gains and their certificate.

    Raises:
        DesignError: if the observer is unstable at the step, or nothing can be proved for the Lipschitz constant.
    """
    direction = np.array(options.disturbance_direction)
    F1 = options.lyapunov_scale * direction
    layer = options.noise_multiple * float(np.linalg.norm(F1 * fault_models.noise_sizes(vehicle, options)[:6]))
    parameters = thau_parameters(vehicle, options) | {
        "disturbance_direction": direction,
        "sliding_surface": rounded(F1, 6),
        "sliding_gain_max": options.sliding_gain_max,
        "sliding_rate": options.sliding_rate,
        "sliding_leak": options.sliding_leak,
        "boundary_layer": rounded(layer, 6),
        "dead_zone": rounded(layer, 6),
    }
    subject = subjects(vehicle, options, parameters)["torques"]
    proof = prove(subject, options.decay_rate, options, "rk4, a shorter step, or a thicker boundary layer")
    parameters |= decision_parameters(vehicle, options, parameters)
    return new_design("asmto", vehicle, options, parameters, [Certificate.of("torques", subject, proof)])


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margin and settling time of the estimate that the verdict rests on."""
    return margins.margin("asmto", vehicle, parameters, "acceleration_fault", options)


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design."""
    model = leaking(fault_models.torque_faults(vehicle, options), parameters)
    still = augmented_gain(vehicle, parameters)
    steepest = parameters["sliding_gain_max"] / parameters["boundary_layer"]
    sliding = np.zeros(still.shape)
    sliding[:6] = steepest * np.outer(parameters["disturbance_direction"], parameters["sliding_surface"])
    return {"torques": Subject(OBSERVER, model, ObserverGain.of(still, still + rounded(sliding)))}
