"""Gains of `rho_adaptive`: robust adaptive observer with switching rho-modification, its threshold and its adaptation.

    x_hat' = A x_hat + B u + xi(x_hat, u) + phi theta_hat + L (y - C x_hat),    x = [v_z, p, q, r]
    theta_hat' = gamma phi^T C^T Y nu - gamma rho_s theta_hat,    nu = y - C x_hat

The paper's matrix inequality has -rho_s I on its diagonal, and rho_s = 0 near theta_hat = 0: it cannot hold there, and
its matrices Theta, M1, M2 are not given. What is solved instead bounds the effect of uncertainty chi and noise d on the
error; for A = 0, C = D = I it has the closed-form solution L = (2 lambda + 2 kappa_1 + 1) I, P = I. Y is normalised by
(phi phi^T)^-1, so that phi theta_hat follows gamma nu: an observer of accelerations, certified as such.

Theorem 1 bounds the noise by its amplitude d, and lets |L| |D| d drive the error all the time. For 4.5 sigma of a gyro
that is several times what the noise does, and hides a loss of 20 %. On vehicles (`noise_form=window`) d is 0 in the
theorem, and quantiles of what random noise leaves in J_nu enter J_th instead (`window_noise`): J_nu <= J_th then holds
with a stated probability, not surely. What the noise in x_hat adds through xi, kappa_1 times 0.01 rad/s, counts as
uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters
from rotordx.gains import fault_models, inequalities, margins, window_noise
from rotordx.gains.certificate import CertifiedDesign, new_design
from rotordx.gains.error_model import ObserverGain
from rotordx.gains.fault_models import FaultObserverOptions
from rotordx.gains.flight_model import flight_model, rate_lipschitz
from rotordx.gains.observer_theory import OBSERVER, prove
from rotordx.gains.options import POSITIVE, DesignError, option
from rotordx.gains.rounding import rounded, rounded_down, rounded_form, rounded_rows
from rotordx.gains.synthesis import solved, value
from rotordx.gains.theory import Certificate, Subject, Theory

Array = NDArray[np.float64]

#: rad/s, of J_th where no random noise enters it: above rounding errors
NUMERICAL_FLOOR = 1e-3

#: s, a warm-up that never ends: the adaptive law is active throughout
NEVER = 1e9

#: Room for rounding: the proved weights of uncertainty and noise are so much larger, relatively, than the optimal ones.
ROOM = 0.01


@dataclass(frozen=True)
class Options(FaultObserverOptions):
    """Options of the design."""

    speed: float = option(
        1.0, "1", "faster (above 1) or quieter (below 1): multiplies convergence_rate and fault_rate", minimum=POSITIVE
    )
    convergence_rate: float = option(
        6.0, "1/s", "lambda: V' + 2 lambda V < mu_chi |chi|^2 + mu_d |d|^2", minimum=POSITIVE
    )
    noise_form: str = option(
        "window",
        "",
        "noise in the threshold: quantile of what it leaves in J_nu, or its amplitude as in Theorem 1",
        choices=("window", "amplitude"),
    )
    noise_exponent: float = option(
        16.0, "1", "x: random noise exceeds its parts of the threshold with a probability of at most 2 exp(-x)"
    )
    loe_max: float = option(0.5, "1", "largest loss considered; the modification starts at N = 1.2 times that")
    modification_rate: float = option(0.3, "1", "rho_0 of the switching modification")
    window: float = option(0.2, "s", "T1 of the residual evaluation")
    initial_error: float = option(0.1, "m/s, rad/s", "bound on the norm of the initial estimation error")
    decay_rate: float = option(
        2.0, "1/s", "alpha that is proved of the adaptation: errors decay at least as exp(-alpha t)", minimum=POSITIVE
    )


@dataclass(frozen=True)
class DetectionModel:
    """e' = (A - L C) e + chi + delta - L D d, |delta| <= lipschitz |e|."""

    states: tuple[str, ...]
    A: Any  #: (n, n)
    C: Any  #: (p, n)
    D: Any  #: (p, p)
    lipschitz: float  #: kappa_1, 1/s


@dataclass(frozen=True)
class DetectionGain:
    """Gain of the observer, and the bounds that its threshold is made for."""

    L: Any  #: (n, p), 1/s
    uncertainty_bound: float  #: chi_bar
    noise_bound: float  #: d_bar


@dataclass(frozen=True)
class DetectionProof:
    """Lyapunov matrix and multiplier, the weights of the bound, and the constants of the threshold (Theorem 1)."""

    P: Any  #: (n, n)
    multiplier: float
    uncertainty_weight: float  #: mu_chi, proved
    noise_weight: float  #: mu_d, proved
    optimum: float  #: smallest mu_chi + mu_d
    convergence_rate: float  #: lambda, 1/s
    decay_rate: float  #: b, 1/s: |exp((A - L C) t)| <= alpha exp(-b t)
    overshoot: float  #: alpha
    smallest_eigenvalue: float  #: bound from below on the eigenvalues of P


def design(vehicle: Vehicle, options: Options) -> CertifiedDesign:
    """Observer gain, threshold constants, learning rate and margins with their certificates.

    Raises:
        DesignError: if there are none, or the adaptation is unstable at the step.
    """
    model = detection_model(vehicle, options)
    L, proof = detection_gain(model, options.convergence_rate * options.speed)
    parameters: dict[str, Any] = {
        "observer_gain": L.flatten(),
        "learning_rate": rounded(float((np.trace(L) / 8) ** 2), 4),  # critically damped with the mean of L
        "decay_rate": proof.decay_rate,
        "overshoot": proof.overshoot,
        "lipschitz": model.lipschitz,
        "gain_norm": rounded(float(np.linalg.norm(L, 2)) * (1 + 1e-5), 6),
        "uncertainty_bound": rounded(float(np.linalg.norm(options.uncertainty)), 6),
        "initial_error": options.initial_error,
        "window": options.window,
        "modification_rate": options.modification_rate,
        "modification_norm": rounded(1.2 * options.loe_max),
        "velocity_filter_bandwidth": vehicle.fill(SensorParameters).velocity_filter_bandwidth,
    }
    remedy = "rk4, a shorter step, or a lower speed"
    adaptation = prove(adaptation_subject(vehicle, options, parameters), options.decay_rate, options, remedy)
    parameters |= noise_parameters(vehicle, options, parameters)
    parameters |= decision_parameters(vehicle, options, parameters)
    about = subjects(vehicle, options, parameters)
    proofs = {
        "detection": proof,
        "adaptation": adaptation,
        "noise": window_noise.NoiseProof(rounded(float(np.sqrt(options.noise_exponent)))),
    }
    certificates = [Certificate.of(name, subject, proofs[name]) for name, subject in about.items()]
    return new_design("rho_adaptive", vehicle, options, parameters, certificates)


def noise_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, float]:
    """What stands for the noise in the threshold: its amplitude, or quantiles of what it leaves in the window."""
    if options.noise_form == "amplitude":
        noise = options.noise_multiple * np.diag(fault_models.acceleration_faults(vehicle, options).V)
        bound = rounded(float(np.linalg.norm(noise)), 6)
        return {"noise_bound": bound, "noise_rms": NUMERICAL_FLOOR, "noise_projection": NUMERICAL_FLOOR}
    energies = noise_energies(vehicle, options, parameters)
    rms, projection = window_noise.quantiles(energies, np.sqrt(options.noise_exponent))
    room = 1 + ROOM
    return {"noise_bound": 0.0, "noise_rms": rounded(rms * room, 4), "noise_projection": rounded(projection * room, 4)}


def noise_energies(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> Array:
    """Energies (3) of the noise in nu while faults are looked for, see `window_noise`."""
    found = margins.responses("rho_adaptive", vehicle, parameters, "output_error", options.step_size)
    return window_noise.energies(found, vehicle.fill(SensorParameters), options.window)


def decision_parameters(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Array]:
    """Margin of the estimate, and the settling time of v_z.

    The adaptive law starts at detection with all faults at 0, and they approach their values together: p, q and r are
    in proportion from the start, and v_z once its filter has settled.
    """
    adapting = parameters | {"warm_up_time": NEVER}
    found = margins.margin("rho_adaptive", vehicle, adapting, "acceleration_estimate", options)
    return found | {"settling_time": found["settling_time"] * np.array([1, 0, 0, 0])}


def detection_model(vehicle: Vehicle, options: Options) -> DetectionModel:
    """Error model of the observer of v_z and body rates."""
    constant = rate_lipschitz(vehicle, options) if options.lipschitz is None else options.lipschitz
    A = rounded(flight_model(vehicle).jacobian)
    return DetectionModel(("v_z", "p", "q", "r"), A, np.eye(4), np.eye(4), rounded(constant))


def detection_gain(model: DetectionModel, convergence_rate: float) -> tuple[Array, DetectionProof]:
    """The gain L with the smallest mu_chi + mu_d, P >= I, and its proof.

    Raises:
        DesignError: if there is none.
    """
    n, p = model.A.shape[0], model.C.shape[0]
    P, PL = cp.Variable((n, n), symmetric=True), cp.Variable((n, p))
    multiplier, uncertainty_weight, noise_weight = cp.Variable(nonneg=True), cp.Variable(), cp.Variable()
    bound = inequalities.disturbance_bound(
        *(P, P @ model.A - PL @ model.C, PL @ model.D, multiplier, uncertainty_weight, noise_weight),
        lipschitz=model.lipschitz,
        decay_rate=convergence_rate,
        block=cp.bmat,
    )
    problem = cp.Problem(cp.Minimize(uncertainty_weight + noise_weight), [bound >> 0, P >> np.eye(n)])
    if not solved(problem):
        raise DesignError(f"no gain converges at {convergence_rate:g} 1/s with these outputs; take a lower speed")
    # the optimum is flat: a relative change of L by 1e-4 costs 1e-8 of it
    L, shape = rounded_rows(np.linalg.solve(value(P), value(PL)), 4), rounded_form(value(P), 4)
    eigenvalues = np.linalg.eigvalsh(shape)
    PA = shape @ (model.A - L @ model.C)
    root = np.linalg.inv(np.linalg.cholesky(shape))
    decay_rate = -np.linalg.eigvalsh(root @ (PA + PA.T) @ root.T)[-1] / 2
    proof = DetectionProof(
        P=shape,
        multiplier=rounded(float(value(multiplier)), 6),
        uncertainty_weight=rounded(float(value(uncertainty_weight)) * (1 + ROOM), 6),
        noise_weight=rounded(float(value(noise_weight)) * (1 + ROOM), 6),
        optimum=rounded(float(value(problem.objective)), 6),
        convergence_rate=convergence_rate,
        decay_rate=rounded_down(float(decay_rate) * (1 - 1e-5)),
        overshoot=rounded(float(np.sqrt(eigenvalues[-1] / eigenvalues[0])) * (1 + 1e-3), 5),
        smallest_eigenvalue=rounded_down(float(eigenvalues[0]) * (1 - 1e-5)),
    )
    return L, proof


def subjects(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> dict[str, Subject]:
    """What the certificates are about, from the vehicle and the FMU parameters of the design."""
    L = np.array(parameters["observer_gain"], dtype=float).reshape(4, 4)
    detection = DetectionGain(L, parameters["uncertainty_bound"], parameters["noise_bound"])
    about = {
        "detection": Subject(DETECTION, detection_model(vehicle, options), detection),
        "adaptation": adaptation_subject(vehicle, options, parameters),
    }
    if options.noise_form == "window":
        noise = window_noise.NoiseModel(noise_energies(vehicle, options, parameters))
        gain = window_noise.NoiseGain(parameters["noise_rms"], parameters["noise_projection"])
        about["noise"] = Subject(window_noise.NOISE, noise, gain)
    return about


def adaptation_subject(vehicle: Vehicle, options: Options, parameters: dict[str, Any]) -> Subject:
    """Observer and adaptive law together: an observer of accelerations."""
    L = np.array(parameters["observer_gain"], dtype=float).reshape(4, 4)
    model = fault_models.acceleration_faults(vehicle, options)
    scale = np.diag(model.A[0][:4, 4:])
    gain = ObserverGain.of(np.vstack((L, rounded(np.diag(parameters["learning_rate"] / scale)))))
    return Subject(OBSERVER, model, gain)


def _inequalities(model: DetectionModel, gain: DetectionGain, proof: DetectionProof) -> dict[str, Any]:
    P, unit = proof.P, inequalities.identity(len(model.states))
    PA = P @ (model.A - gain.L @ model.C)
    return {
        "effect of uncertainty and noise": inequalities.disturbance_bound(
            *(P, PA, P @ gain.L @ model.D, proof.multiplier, proof.uncertainty_weight, proof.noise_weight),
            lipschitz=model.lipschitz,
            decay_rate=proof.convergence_rate,
        ),
        "decay b": -1 * (PA + PA.T) - 2 * proof.decay_rate * P,
        "P from below": P - proof.smallest_eigenvalue * unit,
        "overshoot alpha": proof.overshoot**2 * proof.smallest_eigenvalue * unit - P,
        "b > alpha kappa_1": np.array([[proof.decay_rate - proof.overshoot * model.lipschitz]]),
    }


def _figures(model: DetectionModel, gain: DetectionGain, proof: DetectionProof) -> dict[str, Any]:
    margin = proof.decay_rate - proof.overshoot * model.lipschitz
    noise = float(np.linalg.norm(gain.L, 2) * np.linalg.norm(model.D, 2)) * gain.noise_bound
    steady = proof.overshoot * (gain.uncertainty_bound + noise) / margin
    return {
        "poles": np.sort(np.linalg.eigvals(model.A - gain.L @ model.C).real).tolist(),
        "decay_margin": margin,
        "steady_residual_bound": steady * float(np.linalg.norm(model.C, 2)) + gain.noise_bound,
    }


DETECTION = Theory(
    name="detection",
    statement=(
        "The error obeys V' + 2 lambda V < mu_chi |chi|^2 + mu_d |d|^2; |exp((A - L C) t)| <= alpha exp(-b t) with "
        "b > alpha kappa_1, which is what the threshold of Theorem 1 needs."
    ),
    model=DetectionModel,
    proof=DetectionProof,
    inequalities=_inequalities,
    figures=_figures,
    formulas=(inequalities.disturbance_bound,),
)
