"""Noise covariances and steady gains of the Kalman filters `askf` and `msjfo`, with a proved bound on their errors.

Both estimate x = [v_z, p, q, r, ...] with the thrusts of the four rotors behind their lag, and four losses of
effectiveness gamma that enter as -B diag(u) gamma (Hsieh, Chen 1999; the paper's per-channel form is the same on its
own model). Near hover the steady gain does nearly as well as the filter, for a fraction of its cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains import fault_models, inequalities
from rotordx.gains.analysis import settling_times
from rotordx.gains.discretisation import spectral_radius
from rotordx.gains.fault_models import CHANNELS, ROTOR_FAULTS, FaultObserverOptions
from rotordx.gains.flight_model import flight_model
from rotordx.gains.options import POSITIVE, DesignError, option
from rotordx.gains.rounding import rounded, rounded_form, rounded_rows
from rotordx.gains.theory import Subject, Theory

Array = NDArray[np.float64]

THRUSTS = ("thrust_1", "thrust_2", "thrust_3", "thrust_4")


@dataclass(frozen=True)
class Options(FaultObserverOptions):
    """Options of the design. The losses walk with a variance of (speed fault_rate)^2 step_size a step."""

    fault_rate: float = option(
        0.05, "1/s^0.5", "standard deviation of the losses' random walk after 1 s", minimum=POSITIVE
    )
    acceleration_noise: tuple[float, float, float, float] = option(
        (0.02, 0.1, 0.1, 0.02),
        "m/s^1.5, rad/s^1.5",
        "standard deviation after 1 s of the walks of v_z, p, q, r",
        minimum=POSITIVE,
    )
    thrust_noise: float = option(
        0.02, "1/s^0.5", "of the relative thrust of a rotor, per root of a second", minimum=POSITIVE
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
    """Model in hover: [v_z, p, q, r, (two states of the velocity filter,) thrusts (, losses)], zero-order hold.

    A thrust is relative to that in hover and follows (1 - gamma) u with the motor lag, so that a loss enters by
    -B diag(u) with u = 1.
    """
    lag = ("lagged_acceleration", "filtered_acceleration") if options.filtered_velocity else ()
    states = (*CHANNELS, *lag, *THRUSTS, *ROTOR_FAULTS)
    rate = 1 / float(vehicle.fill(VehicleParameters).motor_time_constant)
    n, hover = len(states), flight_model(vehicle)
    thrusts, gammas = slice(n - 8, n - 4), slice(n - 4, n)
    A = np.zeros((n, n))
    A[:4, :4] = hover.jacobian
    A[1:4, thrusts] = -hover.signatures[1:]  # what a rotor does is what its loss takes away
    A[thrusts, thrusts], A[thrusts, gammas] = -rate * np.eye(4), -rate * np.eye(4)
    if lag:
        bandwidth = float(vehicle.fill(SensorParameters).velocity_filter_bandwidth)
        A[4, thrusts], A[4, 4] = -bandwidth * hover.signatures[0], -bandwidth
        A[5, 4], A[5, 5], A[0, 5] = bandwidth, -bandwidth, 1.0
    else:
        A[0, thrusts] = -hover.signatures[0]
    walk = np.zeros(n)
    walk[:4], walk[thrusts], walk[gammas] = options.acceleration_noise, options.thrust_noise, loss_walk(options)
    used = n if losses else n - 4
    return FilterModel(
        states=states[:used],
        outputs=CHANNELS,
        A=rounded(expm(A * options.step_size)[:used, :used]),
        C=np.eye(4, used),
        Q=rounded(np.diag(walk**2 * options.step_size)[:used, :used]),
        R=rounded(np.diag(fault_models.noise_sizes(vehicle, options)[[6, 3, 4, 5]] ** 2)),
    )


def loss_walk(options: Options) -> float:
    """Standard deviation of a loss after 1 s."""
    return options.fault_rate * options.speed


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
    room = 1e-4 * np.diag(np.diag(covariance))  # for rounding
    bound = solve_discrete_lyapunov(transition, input_gain @ model.R @ input_gain.T + model.Q + room)
    return gain, FilterProof(rounded_form(bound), step_size)


def common_parameters(vehicle: Vehicle, options: Options) -> dict[str, Any]:
    """FMU parameters of both filters: variances a step, of states in the order of `filter_model` without losses."""
    model = filter_model(vehicle, options, losses=False)
    return {
        "process_noise_variance": np.diag(model.Q),
        "measurement_noise_variance": np.diag(model.R),
        "fault_noise_variance": rounded(loss_walk(options) ** 2 * options.step_size),
        "initial_fault_variance": rounded(options.initial_loe_std**2),
    }


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
