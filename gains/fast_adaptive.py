"""Gains of `fast_adaptive`: fast adaptive fault estimator, the baseline of Ren 2020 as reconstructed here.

    x_hat' = A x_hat + B (u + f_hat) + p(x_hat, u) - L e_y,    f_hat' = -Gamma F (e_y' + sigma e_y),    e_y = y_hat - y

with f a torque, L = l I, F = B^T P, P = p I, and sigma = l. Then f_hat = -Gamma F (e_y + sigma integral e_y) needs no
derivative, and answers to a fault like a first-order lag of bandwidth g = Gamma p / J^2, whatever l is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.gains import fault_models
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ObserverGain
from rotordx.gains.fault_models import FaultObserverOptions
from rotordx.gains.margins import margin
from rotordx.gains.observer_theory import OBSERVER, decay_rate_option, prove
from rotordx.gains.options import POSITIVE, option
from rotordx.gains.rounding import rounded
from rotordx.gains.theory import Certificate, Subject


@dataclass(frozen=True)
class Options(FaultObserverOptions):
    """Options of the design."""

    observer_bandwidth: float = option(
        50.0, "1/s", "l, which is sigma too; no fault is estimated faster than this", minimum=POSITIVE
    )
    lyapunov_scale: float = option(
        101.8, "1", "p of P = p I, which scales F up and the learning rate down", minimum=POSITIVE
    )
    decay_rate: float = decay_rate_option()


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Closed-form gains and their certificate.

    The bandwidth g is the compromise between a lag behind random changes of the fault, variance fault_rate^2 / (2 g),
    and noise, variance (g gyro_noise / scale)^2.

    Raises:
        DesignError: if the observer is unstable at the step, or nothing can be proved for the Lipschitz constant.
    """
    inertia = np.asarray(vehicle.fill(VehicleParameters).inertia)
    noise = fault_models.noise_sizes(vehicle, options)[3:6] / fault_models.torque_scale(vehicle)
    bandwidth = np.cbrt(options.fault_rate * options.speed / (2 * noise)) ** 2
    bandwidth = np.minimum(bandwidth, options.observer_bandwidth)
    parameters = {
        "observer_gain": (options.observer_bandwidth * np.eye(6)).flatten(),
        "fault_gain": fault_models.matched_gain(vehicle, options.lyapunov_scale).flatten(),
        "learning_rate": np.array([rounded(v, 6) for v in bandwidth * inertia**2 / options.lyapunov_scale]),
        "integral_rate": options.observer_bandwidth,
    }
    subject = subjects(vehicle, options, parameters)["torques"]
    proof = prove(subject, options.decay_rate, options, "rk4, a shorter step, or a lower speed")
    parameters |= decision_parameters(vehicle, options, parameters)
    return new_design("fast_adaptive", vehicle, options, parameters, [Certificate.of("torques", subject, proof)])


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Any]:
    """Margin and settling time of the estimate that the verdict rests on."""
    return margin("fast_adaptive", vehicle, parameters, "acceleration_fault", options)


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificate is about, from the vehicle and the FMU parameters of the design.

    As an observer for state and fault: z_hat = [x_hat; -sigma Gamma F integral e_y], to which f_hat adds -Gamma F e_y.
    """
    model = fault_models.torque_faults(vehicle, options)
    L = np.array(parameters["observer_gain"], dtype=float).reshape(6, 6)
    direct = fault_models.adaptation_gain(vehicle, parameters["learning_rate"], parameters["fault_gain"])
    injection = np.vstack((L + model.A[0][:6, 6:] @ direct, parameters["integral_rate"] * direct))
    gain = ObserverGain((rounded(injection),), np.vstack((np.zeros((6, 6)), rounded(direct))))
    return {"torques": Subject(OBSERVER, model, gain)}
