"""Gains of `smo`: sliding mode observer of v_z and body rates, the baseline of the rho-modification paper.

    x_hat' = f(x_hat, u) + k e + M sat(e / boundary_layer),    e = y - x_hat

channel by channel. The equivalent injection k e + M sat(...), filtered, is the acceleration by the fault. Within the
boundary layer the injection has the slope k + M / boundary_layer, outside it falls towards k: one certificate holds for
the sector between the two, and M exceeds every acceleration that it has to cancel, so that the layer is reached.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters
from rotordx.gains import fault_models, margins
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ErrorModel, ObserverGain
from rotordx.gains.fault_models import ObserverOptions
from rotordx.gains.flight_model import flight_model
from rotordx.gains.observer_theory import OBSERVER, decay_rate_option, proof_inequalities, prove
from rotordx.gains.options import POSITIVE, DesignError, option
from rotordx.gains.rounding import rounded
from rotordx.gains.synthesis import Proof
from rotordx.gains.theory import Certificate, Subject

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Options(ObserverOptions):
    """Options of the design."""

    speed: float = option(
        1.0, "1", "faster (above 1) or quieter (below 1): multiplies fault_rate and layer_gain", minimum=POSITIVE
    )
    fault_rate: float = option(
        0.1, "1/s", "how fast losses are expected to change: decides the filter of the injection", minimum=POSITIVE
    )
    loe_max: float = option(0.5, "1", "largest loss of one rotor whose acceleration the sliding term cancels")
    reserve: float = option(1.2, "1", "M over the largest acceleration that it has to cancel", minimum=1.01)
    linear_gain: float = option(20.0, "1/s", "k, the slope of the injection far outside the layer")
    layer_gain: float = option(40.0, "1/s", "slope of the injection within the boundary layer", minimum=POSITIVE)
    decay_rate: float = decay_rate_option()


@dataclass(frozen=True)
class SlidingGain(ObserverGain):
    """Both ends of the sector, and what the sliding term can cancel."""

    limit: Any  #: (4, 4), diagonal of M


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Closed-form gains and their certificate.

    The filter of the injection is the compromise between a lag behind random changes of the fault, variance
    fault_rate^2 time_constant / 2, and noise, variance (noise/signature)^2 step_size layer_gain / (2 time_constant^2).

    Raises:
        DesignError: if the observer is unstable at the step, or nothing can be proved for the Lipschitz constant.
    """
    limit, layer_gain = options.reserve * to_cancel(vehicle, options), options.layer_gain * options.speed
    if layer_gain <= options.linear_gain:
        raise DesignError(f"the slope {layer_gain:g} 1/s within the layer must exceed linear_gain; take a higher speed")
    noise = fault_models.noise_sizes(vehicle, options)[[6, 3, 4, 5]]
    signature = np.abs(flight_model(vehicle).signatures).max(axis=1)
    density = (noise / signature) ** 2 * options.step_size
    filter_time = np.cbrt(density * layer_gain / (options.fault_rate * options.speed) ** 2)
    parameters: dict[str, Any] = {
        "linear_gain": np.full(4, options.linear_gain),
        "sliding_gain": np.array([rounded(v, 6) for v in limit]),
        "boundary_layer": np.array([rounded(v, 6) for v in limit / (layer_gain - options.linear_gain)]),
        "filter_time_constant": np.array([rounded(v, 6) for v in filter_time]),
        "velocity_filter_bandwidth": vehicle.fill(SensorParameters).velocity_filter_bandwidth,
    }
    subject = subjects(vehicle, options, parameters)["channels"]
    proof = prove(subject, options.decay_rate, options, "a shorter step, a lower speed or a smaller layer_gain")
    parameters |= decision_parameters(vehicle, options, parameters)
    return new_design("smo", vehicle, options, parameters, [Certificate.of("channels", subject, proof)])


def to_cancel(vehicle: Vehicle, options: Options) -> Array:
    """Accelerations (4) of v_z, p, q, r by the largest loss of one rotor in hover and by what is unknown."""
    return options.loe_max * np.abs(flight_model(vehicle).signatures).max(axis=1) + np.array(options.uncertainty)


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margin and settling time of the estimate that the verdict rests on."""
    return margins.margin("smo", vehicle, parameters, "acceleration_estimate", options)


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design."""
    model = fault_models.channels(vehicle, options, to_cancel(vehicle, options))
    linear, limit = np.array(parameters["linear_gain"]), np.array(parameters["sliding_gain"])
    steepest = linear + limit / np.array(parameters["boundary_layer"])
    injections = (np.diag(rounded(steepest)), np.diag(linear))  # within the layer, and far outside it
    return {"channels": Subject(SLIDING, model, SlidingGain(injections, np.zeros((4, 4)), np.diag(limit)))}


def _inequalities(model: ErrorModel, gain: SlidingGain, proof: Proof) -> dict[str, Any]:
    return {"sliding term exceeds what it cancels": gain.limit - model.E} | proof_inequalities(model, gain, proof)


SLIDING = dataclasses.replace(
    OBSERVER,
    name="sliding",
    statement="The sliding term exceeds every acceleration within the bounds. " + OBSERVER.statement,
    inequalities=_inequalities,
)
