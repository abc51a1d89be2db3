"""Gains of `hinf`: robust H-infinity observer of state and faults (Ren 2020, corrected and solved with one full P).

Two observers in one design: `vz4` estimates four rotor faults from attitude, rates and vertical velocity, `tau3` three
torque faults from attitude and rates alone. The README beside this file says what is wrong with the paper's matrix
inequalities (32), (42) and (57), and what is solved instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rotordx.fmus.diagnosers.hinf.observer import MODELS as FLOWN
from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters
from rotordx.gains import fault_models
from rotordx.gains.analysis import undetectable_directions
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ErrorModel, ObserverGain
from rotordx.gains.fault_models import FaultObserverOptions
from rotordx.gains.flight_model import flight_model
from rotordx.gains.margins import margin
from rotordx.gains.observer_theory import OBSERVER
from rotordx.gains.options import DesignError, option
from rotordx.gains.rounding import rounded
from rotordx.gains.synthesis import Requirements, quietest_gain
from rotordx.gains.theory import Certificate, Subject

#: Error models by name, and the FMU parameters that their gains go to.
MODELS: dict[str, tuple[Callable[[Vehicle, FaultObserverOptions], ErrorModel], str]] = {
    "vz4": (fault_models.rotor_faults, "observer_gain"),
    "tau3": (fault_models.torque_faults, "torque_observer_gain"),
    "attitude4": (fault_models.rotor_faults_from_attitude, "observer_gain"),
}


@dataclass(frozen=True)
class Options(Requirements, FaultObserverOptions):
    """Options of the design."""

    models: tuple[str, ...] = option(
        ("vz4", "tau3"), "", "observers to design; attitude4, the paper's own model, is undetectable and refused"
    )


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Design the observers and their certificates.

    Raises:
        DesignError: if a model cannot be observed as asked.
    """
    parameters: dict[str, Any] = {
        "fault_model": next((FLOWN.index(name) for name in options.models if name in FLOWN), 0),
        "hover_speed": rounded(flight_model(vehicle).hover_speed),
        "velocity_filter_bandwidth": vehicle.fill(SensorParameters).velocity_filter_bandwidth,
    }
    certificates = []
    for name in options.models:
        model, port = _model(name)[0](vehicle, options), _model(name)[1]
        require_detectable(name, model)
        gain, proof = quietest_gain(model, options, options.step_size, options.integrator)
        parameters[port] = gain.injections[0].flatten()
        certificates.append(Certificate.of(name, Subject(OBSERVER, model, gain), proof))
        parameters |= _decision_parameters(name, vehicle, options, parameters)
    return new_design("hinf", vehicle, options, parameters, certificates)


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margins and settling times of the diagnoser, whichever model it flies."""
    found: dict[str, Any] = {}
    for name in options.models:
        found |= _decision_parameters(name, vehicle, options, parameters)
    return found


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificates are about, from the vehicle and the FMU parameters of the design."""
    result = {}
    for name in options.models:
        build, port = _model(name)
        model = build(vehicle, options)
        gain = np.array(parameters[port], dtype=float).reshape(len(model.states), len(model.outputs))
        result[name] = Subject(OBSERVER, model, ObserverGain.of(gain))
    return result


def require_detectable(name: str, model: ErrorModel) -> None:
    """Refuse a model with faults that no measurement shows.

    Raises:
        DesignError: naming the direction.
    """
    for direction in undetectable_directions(model.A[0], model.C).T:
        faults = direction[model.faults]
        whole = np.round(faults / faults[np.abs(faults).argmax()], 3)
        text = ", ".join(f"{v:g}" for v in whole)
        raise DesignError(
            f"the model {name} cannot tell all its faults from its measurements: the direction [{text}] of the faults "
            "leaves attitude and body rates as they are; measure the vertical velocity too (model vz4)"
        )


def _decision_parameters(name: str, vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margins and settling times of the diagnoser that flies a model; with an ideal v_z, nothing flies `vz4`."""
    if name == "vz4" and not options.filtered_velocity:
        return {}
    needed = ("hover_speed", "velocity_filter_bandwidth", MODELS[name][1])
    flown = {port: parameters[port] for port in needed} | {"fault_model": FLOWN.index(name)}
    found = margin("hinf", vehicle, flown, "acceleration_fault", options)
    if name == "tau3":
        return {f"torque_{port}": value for port, value in found.items()}
    return found | {"rotor_loss_margin": margin("hinf", vehicle, flown, "rotor_loss", options)["margin"]}


def _model(name: str) -> tuple[Callable[[Vehicle, FaultObserverOptions], ErrorModel], str]:
    if name not in MODELS:
        raise DesignError(f"hinf has no model {name}; choose among {', '.join(MODELS)}")
    return MODELS[name]
