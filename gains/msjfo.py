"""Gains of `msjfo`: multi-stage joint fault observer, its noise and the gain of its bias-free stage.

The bias-free gain does not depend on the commands; held, it makes Friedland's separate-bias filter (`fixed_gain`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains import kalman
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.kalman import Options
from rotordx.gains.rounding import rounded
from rotordx.gains.theory import Certificate, Subject

__all__ = ["Options", "decision_parameters", "design", "subjects"]


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Covariances, the steady gain of the bias-free stage, and certificates of that and of the joint estimate.

    Raises:
        DesignError: if there is no steady state.
    """
    model = kalman.filter_model(vehicle, options, losses=False)
    gain, bias_free = kalman.steady_filter(model, options.step_size)
    innovation = np.diag(model.C @ bias_free.P @ model.C.T + model.R)
    _, joint = kalman.steady_filter(kalman.filter_model(vehicle, options, losses=True), options.step_size)
    parameters = kalman.noise_parameters(vehicle, options) | {
        "bias_free_gain": gain.flatten(),
        "bias_free_innovation_variance": rounded(innovation, 6),
    }
    parameters |= decision_parameters(vehicle, options, parameters)
    about = subjects(vehicle, options, parameters)
    certificates = [
        Certificate.of("joint", about["joint"], joint),
        Certificate.of("bias_free", about["bias_free"], bias_free),
    ]
    return new_design("msjfo", vehicle, options, parameters, certificates)


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margins and settling times."""
    return kalman.decision_parameters("msjfo", vehicle, options, parameters)


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificates are about, from the vehicle and the FMU parameters of the design.

    The stages together are the optimal filter: in hover their gain becomes that of the covariances.
    """
    joint, _ = kalman.steady_filter(kalman.filter_model(vehicle, options, losses=True), options.step_size)
    return {
        "joint": kalman.subject(vehicle, options, joint, losses=True),
        "bias_free": kalman.subject(vehicle, options, parameters["bias_free_gain"], losses=False),
    }
