"""Gains of `askf`: augmented-state Kalman filter of states and losses, its noise and its steady gain in hover."""

from __future__ import annotations

from typing import Any

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains import kalman
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.kalman import Options
from rotordx.gains.theory import Certificate, Subject

__all__ = ["Options", "decision_parameters", "design", "subjects"]


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Covariances, and the steady gain with its certificate.

    Raises:
        DesignError: if the filter has no steady state.
    """
    gain, proof = kalman.steady_filter(kalman.filter_model(vehicle, options, losses=True), options.step_size)
    parameters = kalman.noise_parameters(vehicle, options) | {"kalman_gain": gain.flatten()}
    parameters |= decision_parameters(vehicle, options, parameters)
    about = subjects(vehicle, options, parameters)["augmented"]
    return new_design("askf", vehicle, options, parameters, [Certificate.of("augmented", about, proof)])


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margins and settling times."""
    return kalman.decision_parameters("askf", vehicle, options, parameters)


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design."""
    return {"augmented": kalman.subject(vehicle, options, parameters["kalman_gain"], losses=True)}
