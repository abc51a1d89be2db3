"""Noise covariances and steady gains of the Kalman filters `askf` and `msjfo`, with a proved bound on their errors.

Both take the model of `rotordx.fmus.diagnosers.rotor_losses`, evaluated in hover, with four losses of effectiveness
gamma that enter as -B diag(u) gamma (Hsieh, Chen 1999; the paper's per-channel form is the same on its own model). Near
hover the steady gain does nearly as well as the filter, for a fraction of its cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_discrete_are, solve_discrete_lyapunov

from rotordx.fmus.diagnosers import rotor_losses
from rotordx.fmus.diagnosers.interface import Command, Measured
from rotordx.fmus.shell.ports import start_values, unflatten, with_starts
from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains import fault_models, inequalities, margins
from rotordx.gains.analysis import settling_times
from rotordx.gains.certificate import plain
from rotordx.gains.discretisation import spectral_radius
from rotordx.gains.fault_models import CHANNELS, ROTOR_FAULTS, FaultObserverOptions
from rotordx.gains.flight_model import flight_model
from rotordx.gains.options import POSITIVE, DesignError, option
from rotordx.gains.rounding import rounded, rounded_form, rounded_rows
from rotordx.gains.theory import Subject, Theory

Array = NDArray[np.float64]

#: The filtered velocity is read without an error of its own; so much of what a step's position noise adds to it, in
#: standard deviations, keeps the covariance well conditioned in single precision.
READING_ERROR = 0.1

#: Estimates rise together if their step responses differ by no more; the decision allows for so much (signature_error).
TOGETHER = 0.1


@dataclass(frozen=True)
class Options(FaultObserverOptions):
    """Options of the design. The losses walk with a variance of (speed fault_rate)^2 a second."""

    fault_rate: float = option(
        0.01, "1/s^0.5", "standard deviation of the losses' random walk after 1 s", minimum=POSITIVE
    )
    acceleration_noise: tuple[float, float, float, float] = option(
        (0.01, 0.02, 0.02, 0.005),
        "m/s^1.5, rad/s^1.5",
        "standard deviation after 1 s of the walks of v_z, p, q, r",
        minimum=POSITIVE,
    )
    thrust_noise: float = option(
        0.001, "1/s^0.5", "of the relative thrust of a rotor, per root of a second", minimum=POSITIVE
    )
    initial_loe_std: float = option(0.1, "1", "standard deviation of the losses at the start", minimum=POSITIVE)


@dataclass(frozen=True)
class FilterModel:
    """x+ = A x + w, y = C x + v at the step of the filter."""

    states: tuple[str, ...]
    outputs: tuple[str, ...]
    A: Any  #: (n, n)
    C: Any  #: (p, n)
    Q: Any  #: (n, n), covariance of w
    R: Any  #: (p, p), covariance of v


@dataclass(frozen=True)
class FilterProof:
    """A bound on the covariance of the error of the one-step prediction, with the steady gain."""

    P: Any  #: (n, n)
    step_size: float  #: s


def filter_model(vehicle: Vehicle, options: Options, *, losses: bool) -> FilterModel:
    """The model that the diagnosers step, in hover, with or without losses.

    Raises:
        DesignError: if v_z is to be taken for ideal, which the diagnosers do not.
    """
    if not options.filtered_velocity:
        raise DesignError("askf and msjfo contain the velocity filter; leave filtered_velocity true")
    body = vehicle.fill(VehicleParameters)
    state = unflatten(rotor_losses.VehicleState, ca.DM(start_values(rotor_losses.VehicleState)))
    measured = Measured(euler=ca.DM.zeros(3), body_rate=ca.DM.zeros(3), vertical_velocity=0)
    command = Command(rotor_speed_command=ca.DM(flight_model(vehicle).hover_speed))
    interval = rotor_losses.known_interval(measured, command, state, body, options.step_size)
    cls = with_starts(rotor_losses.FilterParameters, plain(noise_parameters(vehicle, options)))
    step = rotor_losses.step_model(interval, unflatten(cls, ca.DM(start_values(cls))), body, options.step_size)
    A, E, C, Q, Q_gamma = (
        ca.evalf(matrix).full()
        for matrix in (step.transition, step.loss_input, step.measurement, step.process_noise, step.loss_noise)
    )
    R = np.diag(ca.evalf(ca.SX(step.measurement_noise)).full().ravel())
    states = rotor_losses.STATES
    if losses:
        m = E.shape[1]
        A = np.block([[A, E], [np.zeros((m, len(A))), np.eye(m)]])
        C, Q, states = np.hstack([C, np.zeros((len(C), m))]), block_diag(Q, Q_gamma), (*states, *ROTOR_FAULTS)
    return FilterModel(states, CHANNELS, rounded(A), C, Q, R)


def noise_parameters(vehicle: Vehicle, options: Options) -> dict[str, Any]:
    """FMU parameters of both filters that say what noise there is."""
    bandwidth = float(vehicle.fill(SensorParameters).velocity_filter_bandwidth)
    noise = fault_models.noise_sizes(vehicle, options)
    position_density = noise[6] ** 2 * 4 / bandwidth**3  # which leaves that noise in v_z
    reading = READING_ERROR * bandwidth**2 * np.sqrt(position_density * options.step_size)
    return {
        "velocity_filter_bandwidth": bandwidth,
        "acceleration_noise_density": rounded(np.square(options.acceleration_noise)),
        "thrust_noise_density": rounded(options.thrust_noise**2),
        "loss_noise_density": rounded((options.fault_rate * options.speed) ** 2),
        "position_noise_density": rounded(position_density),
        "measurement_noise_variance": rounded(np.array([reading, *noise[3:6]]) ** 2, 6),
        "initial_loss_variance": rounded(options.initial_loe_std**2),
        "detection_quantile": options.noise_multiple,
    }


def decision_parameters(
    diagnoser: str, vehicle: Vehicle, options: Options, parameters: dict[str, Any]
) -> dict[str, Any]:
    """Margin by unknown accelerations alone (noise is covered by the filter's covariance), and settling times.

    Channels whose estimates rise together with the fastest one's need not settle: on its way up, a loss looks like a
    smaller one of the same rotor.
    """
    found = margins.responses(diagnoser, vehicle, plain(parameters), "acceleration_fault", options.step_size)
    settling = found.settling_time()
    rises = np.cumsum(found.accelerations[:, range(4), range(4)], axis=0)
    rises /= rises[-1]
    apart = np.abs(rises - rises[:, [np.argmin(settling)]]).max(axis=0)
    return {
        "margin": rounded(found.peak_gain() @ np.asarray(options.uncertainty), 4),
        "settling_time": rounded(np.where(apart < TOGETHER, 0.0, settling), 3),
    }


def steady_filter(model: FilterModel, step_size: float) -> tuple[Array, FilterProof]:
    """Steady gain K (n, p) of x_hat = x_predicted + K (y - C x_predicted), and its proof.

    Raises:
        DesignError: if there is no steady filter.
    """
    try:
        covariance = solve_discrete_are(model.A.T, model.C.T, model.Q, model.R)
    except np.linalg.LinAlgError as error:
        raise DesignError(f"the filter has no steady state ({error}); give every state some process noise") from error
    innovation = model.C @ covariance @ model.C.T + model.R
    gain = rounded_rows(np.linalg.solve(innovation, model.C @ covariance).T)
    transition, input_gain = _closed(model, gain)
    room = 1e-5 * np.diag(np.diag(covariance))  # for rounding
    bound = solve_discrete_lyapunov(transition, input_gain @ model.R @ input_gain.T + model.Q + room)
    return gain, FilterProof(rounded_form(bound), step_size)


def subject(vehicle: Vehicle, options: Options, gain: Any, *, losses: bool) -> Subject:
    """What a certificate is about: the model and a gain given by rows."""
    model = filter_model(vehicle, options, losses=losses)
    return Subject(COVARIANCE, model, np.array(gain, dtype=float).reshape(len(model.states), 4))


def _closed(model: FilterModel, gain: Any) -> tuple[Any, Any]:
    """(A - A K C, A K): what the error of the one-step prediction, and the measurement noise, become a step later."""
    input_gain = model.A @ gain
    return model.A - input_gain @ model.C, input_gain


def _inequalities(model: FilterModel, gain: Any, proof: FilterProof) -> dict[str, Any]:
    transition, input_gain = _closed(model, gain)
    bound = inequalities.covariance_bound(proof.P, transition, input_gain, model.R, model.Q)
    return {"covariance": proof.P, "covariance bound": bound}


def _figures(model: FilterModel, gain: Array, proof: FilterProof) -> dict[str, Any]:
    transition, input_gain = _closed(model, gain)
    radius = spectral_radius(transition)
    if radius >= 1:
        raise np.linalg.LinAlgError("the filter is unstable")
    steady = solve_discrete_lyapunov(transition, input_gain @ model.R @ input_gain.T + model.Q)
    after = np.eye(len(model.states)) - gain @ model.C
    std = np.sqrt(np.diag(after @ steady @ after.T + gain @ model.R @ gain.T))
    estimates = slice(-4, None) if "fault" in model.states[-1] else slice(0, 4)
    return {
        "spectral_radius": radius,
        "estimates": list(model.states[estimates]),
        "noise_std": std[estimates].tolist(),
        "settling_time": settling_times(transition, np.eye(len(std))[estimates], estimates, proof.step_size),
        "largest_excess_of_bound": float((np.diag(proof.P) / np.diag(steady)).max() - 1),
    }


def _limits(proof: FilterProof, figures: dict[str, Any]) -> dict[str, tuple[float, float]]:
    return {"spectral radius of the step": (figures["spectral_radius"], 1.0)}


COVARIANCE = Theory(
    name="covariance",
    statement=(
        "With the steady gain, and noise of covariances up to Q and R, the covariance of the one-step prediction error "
        "stays below P once it is; the filter is stable."
    ),
    model=FilterModel,
    proof=FilterProof,
    inequalities=_inequalities,
    figures=_figures,
    formulas=(inequalities.covariance_bound,),
    limits=_limits,
)
