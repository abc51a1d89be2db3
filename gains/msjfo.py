"""Gains of `msjfo`: multi-stage joint fault observer, its noise and the gain of its bias-free stage.

The bias-free gain does not depend on the commands; held, it makes Friedland's separate-bias filter (`fixed_gain`).
"""

from __future__ import annotations

from typing import Any

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains import kalman
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.kalman import Options
from rotordx.gains.theory import Certificate, Subject

__all__ = ["Options", "design", "subjects"]


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Covariances, and the steady gain of the bias-free stage with its certificate.

    Raises:
        DesignError: if that stage has no steady state.
    """
    gain, proof = kalman.steady_filter(kalman.filter_model(vehicle, options, losses=False), options.step_size)
    parameters = kalman.common_parameters(vehicle, options) | {"bias_free_gain": gain.flatten()}
    about = subjects(vehicle, options, parameters)["bias_free"]
    return new_design("msjfo", vehicle, options, parameters, [Certificate.of("bias_free", about, proof)])


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design."""
    return {"bias_free": kalman.subject(vehicle, options, parameters["bias_free_gain"], losses=False)}
