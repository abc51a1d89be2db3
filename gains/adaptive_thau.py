"""Gains of `adaptive_thau`: Thau observer with an adaptive fault estimate (Nguyen, Hong 2018, (13), (20) without v).

    x_hat' = A x_hat + p(x_hat, u) + B (u + f_hat) - K (y_hat - y),    f_hat' = -Gamma (F2 (y_hat - y) + leak f_hat)

with f a torque, K of Lemma 1 and F2 = B^T P, P = p I, exactly (19) for C = I. In the coordinates of an observer for
state and fault the gain is [K; Gamma F2]: its certificate replaces (17), which no matrices fulfil.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.gains import fault_models, margins
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ErrorModel, ObserverGain
from rotordx.gains.fault_models import FaultObserverOptions
from rotordx.gains.observer_theory import OBSERVER, decay_rate_option, prove
from rotordx.gains.options import POSITIVE, option
from rotordx.gains.rounding import rounded, rounded_rows
from rotordx.gains.thau import thau_gain
from rotordx.gains.theory import Certificate, Subject

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Options(FaultObserverOptions):
    """Options of the design."""

    epsilon: float = option(100.0, "1/s", "of Lemma 1: K places the observer's poles near -epsilon", minimum=POSITIVE)
    lyapunov_scale: float = option(
        101.8,
        "1",
        "p of P = p I in (19), which scales F2 up and the learning rate down; 101.8 is printed",
        minimum=POSITIVE,
    )
    learning_rate: tuple[float, float, float] | None = option(
        None,
        "N2.m2",
        "diagonal of Gamma; none: the steady Kalman filter's for fault_rate and gyro noise, if that is damped",
        minimum=POSITIVE,
    )
    leak: float = option(1.0, "1/(N.m)", "leak of the fault estimate, kappa: makes (20) robust and biases it a little")
    decay_rate: float = decay_rate_option()


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Closed-form gains and their certificate.

    Raises:
        DesignError: if the observer is unstable at the step, or nothing can be proved for the Lipschitz constant.
    """
    parameters = thau_parameters(vehicle, options)
    subject = subjects(vehicle, options, parameters)["torques"]
    proof = prove(subject, options.decay_rate, options, "rk4, a shorter step, or a lower speed")
    parameters |= decision_parameters(vehicle, options, parameters)
    return new_design("adaptive_thau", vehicle, options, parameters, [Certificate.of("torques", subject, proof)])


def thau_parameters(vehicle: Vehicle, options: Options) -> dict[str, Any]:
    """FMU parameters K, F2, Gamma and leak.

    A random walk of the fault of intensity (fault_rate scale)^2, seen through gyro noise of density gyro_noise^2
    step_size, gives the steady Kalman filter a gain from rate to fault of (fault_rate scale) / (gyro_noise
    sqrt(step_size)), which is p Gamma / J^2. All three estimates then carry the same noise relative to their scales.
    But K is not that filter's: the loop is s^2 + epsilon s + p Gamma / J^2; beyond (2/3 epsilon)^2, a damping of 3/4
    and an overshoot of 3 %, the estimate becomes noisier without settling sooner.
    """
    inertia = np.asarray(vehicle.fill(VehicleParameters).inertia)
    model = fault_models.torque_faults(vehicle, options)
    A, C = model.A[0][:6, :6], model.C[:, :6]
    if options.learning_rate is None:
        density = fault_models.noise_sizes(vehicle, options)[3:6] * np.sqrt(options.step_size)
        rate_to_fault = options.fault_rate * options.speed * fault_models.torque_scale(vehicle) / density
        damped = np.minimum(rate_to_fault, (2 / 3 * options.epsilon) ** 2)
        learning_rate = rounded(damped * inertia**2 / options.lyapunov_scale, 6)
    else:
        learning_rate = np.array(options.learning_rate)
    return {
        "observer_gain": rounded_rows(thau_gain(A, C, options.epsilon)).flatten(),
        "fault_gain": fault_models.matched_gain(vehicle, options.lyapunov_scale).flatten(),
        "learning_rate": learning_rate,
        "leak": options.leak,
    }


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margin and settling time of the estimate that the verdict rests on."""
    return margins.margin("adaptive_thau", vehicle, parameters, "acceleration_fault", options)


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design."""
    model = leaking(fault_models.torque_faults(vehicle, options), parameters)
    return {"torques": Subject(OBSERVER, model, ObserverGain.of(augmented_gain(vehicle, parameters)))}


def leaking(model: ErrorModel, parameters: dict[str, Any]) -> ErrorModel:
    """The error model with the leak: f - f_hat forgets itself, and Gamma leak f joins f' in the disturbance."""
    A = model.A[0].copy()
    A[model.faults, model.faults] = -np.diag(np.asarray(parameters["learning_rate"]) * parameters["leak"])
    return dataclasses.replace(model, A=(rounded(A),))


def augmented_gain(vehicle: Vehicle, parameters: dict[str, Any]) -> Array:
    """[K; Gamma F2] (9, 6), its last rows in units of the largest torque that the loss of a rotor takes away."""
    K = np.array(parameters["observer_gain"], dtype=float).reshape(6, 6)
    return np.vstack((K, fault_models.adaptation_gain(vehicle, parameters["learning_rate"], parameters["fault_gain"])))
