"""Semidefinite programs: the best observer for an error model, and the best proof for a given observer.

CVXPY states them, Clarabel solves them. Nothing that a solver says is believed: what comes out is rounded, and proved
from its own numbers by `rotordx.gains.verify` before it is written.
"""

from __future__ import annotations

import dataclasses
import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from rotordx.gains import inequalities
from rotordx.gains.discretisation import step_matrix
from rotordx.gains.error_model import ErrorModel, ObserverGain
from rotordx.gains.options import POSITIVE, DesignError, option
from rotordx.gains.rounding import rounded, rounded_down, rounded_form, rounded_gain

Array = NDArray[Any]

#: Of the solver: above the accuracy at which it gets stuck, and its digits begin to depend on the processor.
TOLERANCE = 1e-7

#: Room for rounding: what is finally solved is so much stricter, relatively, than what is claimed.
ROOM = 0.01


@dataclass(frozen=True)
class Requirements:
    """What is asked of the observer's dynamics, besides a small gain from disturbance and noise to error."""

    decay_rate: float = option(2.0, "1/s", "alpha: errors decay at least as exp(-alpha t)", minimum=POSITIVE)
    disk_radius: float | None = option(
        50.0, "1/s", "q: all poles within the disk around -q of radius q, which bounds the gains", minimum=POSITIVE
    )
    gamma_ratio: float = option(
        1.05, "1", "gamma of the design over the smallest possible one; the room is spent on less noise", minimum=1.0
    )

    def with_room(self) -> Requirements:
        """The same, stricter by `ROOM`."""
        radius = None if self.disk_radius is None else self.disk_radius * (1 - ROOM)
        return dataclasses.replace(self, decay_rate=self.decay_rate * (1 + ROOM), disk_radius=radius)


@dataclass(frozen=True)
class Proof:
    """What makes the inequalities true for a gain: their free matrices, and what they claim."""

    P: Any  #: (n, n), Lyapunov matrix
    multiplier: float  #: of the S-procedure for the nonlinearity
    gamma: float  #: gain from disturbance and noise to z, proved
    gamma_optimum: float  #: smallest one for the model and the requirements
    decay_rate: float  #: 1/s, proved
    disk_radius: float | None  #: 1/s, proved; None if it is not claimed
    step_size: float  #: s, of the step that contracts P
    integrator: str


@dataclass(frozen=True)
class Solution:
    """Values at the optimum of a program."""

    P: Array
    PL: Array
    multiplier: float
    gamma: float


def quietest_gain(
    model: ErrorModel, requirements: Requirements, step_size: float, integrator: str
) -> tuple[ObserverGain, Proof]:
    """The observer with the least noise among those whose gamma is nearly the smallest possible one.

    First the smallest gamma over P, Y = P L and the multiplier; then, with gamma held at `gamma_ratio` times that, the
    least trace(E^T P E) + trace((L V)^T P (L V)), the energy that disturbances and noise drive into the Lyapunov
    function. (The smallest gamma alone leaves the gains of all but the worst channel undetermined.)

    Raises:
        DesignError: if there is none; the message says what is in the way.
    """
    best = solve(model, requirements)
    if best is None:
        raise DesignError(_obstacle(model, requirements))
    gamma = rounded_down(requirements.gamma_ratio * best.gamma)
    final = solve(model, requirements.with_room(), gamma=gamma * (1 - ROOM))
    if final is None:
        raise DesignError(f"gamma_ratio {requirements.gamma_ratio:g} leaves no room for rounding; take at least 1.03")
    L = np.linalg.solve(final.P, final.PL)
    gain = ObserverGain.of(rounded_gain(L, final.P, model.C, requirements.decay_rate))
    return gain, _proof(final, gamma, best.gamma, requirements, step_size, integrator)


def best_proof(
    model: ErrorModel, gain: ObserverGain, requirements: Requirements, step_size: float, integrator: str
) -> Proof:
    """The smallest gamma, times `gamma_ratio`, that can be proved for a given gain.

    Raises:
        DesignError: if not even stability can be proved for the model's Lipschitz constant.
    """
    steps = [step_matrix(loop.A, step_size, integrator) for loop in model.close(gain)]
    best = solve(model, requirements, gain=gain, steps=steps)
    if best is None:
        raise DesignError(_obstacle(model, requirements, gain=gain, steps=steps))
    gamma = rounded_down(requirements.gamma_ratio * best.gamma)
    final = solve(model, requirements.with_room(), gain=gain, steps=steps, gamma=gamma * (1 - ROOM))
    if final is None:
        raise DesignError(f"gamma_ratio {requirements.gamma_ratio:g} leaves no room for rounding; take at least 1.03")
    return _proof(final, gamma, best.gamma, requirements, step_size, integrator)


def solve(
    model: ErrorModel,
    requirements: Requirements,
    *,
    gain: ObserverGain | None = None,
    steps: Sequence[Array] = (),
    gamma: float | None = None,
) -> Solution | None:
    """Solve one program: for the smallest gamma, or for the least energy with gamma given.

    Args:
        gain: held if given, else P L is free.
        steps: step matrices that have to contract P as well; with a given gain.
        gamma: held if given.

    Returns:
        the optimum, None if the inequalities contradict each other.
    """
    T, size = _natural_coordinates(model, requirements.decay_rate, gain)
    scaled = _transformed(model, T, size)
    held = None if gain is None else ObserverGain(tuple(T @ L for L in gain.injections), T @ gain.direct)
    program = _Program(scaled, requirements, held, None if gamma is None else gamma / size)
    program.constraints += [inequalities.contraction(program.P, T @ step @ np.linalg.inv(T)) >> 0 for step in steps]
    if not program.solve():
        return None
    return Solution(
        P=size**2 * T.T @ (value(program.P) + value(program.P).T) / 2 @ T,
        PL=size**2 * T.T @ value(program.PL[0]),
        multiplier=size**2 * float(value(program.multiplier)),
        gamma=size * float(np.sqrt(value(program.squared_gain))),
    )


class _Program:
    """Variables, constraints and objective of one semidefinite program, in the coordinates of its model."""

    def __init__(
        self, model: ErrorModel, requirements: Requirements, gain: ObserverGain | None, gamma: float | None
    ) -> None:
        n, p = len(model.states), len(model.outputs)
        self.P = cp.Variable((n, n), symmetric=True)
        self.PL = [cp.Variable((n, p))] if gain is None else [self.P @ L for L in gain.injections]
        self.multiplier = cp.Variable(nonneg=True)
        self.squared_gain = cp.Variable() if gamma is None else cp.Constant(gamma**2)
        self.constraints = [self.P >> 0]
        C, F = model.performance(np.zeros((n, p)) if gain is None else gain.direct)
        for PL, A in itertools.product(self.PL, model.A):
            PA = self.P @ A - PL @ model.C
            PB = cp.hstack((self.P @ model.E, -PL @ model.V))
            bounded_real = inequalities.bounded_real(
                *(self.P, PA, PB, self.P @ model.D, model.N, C, F),
                lipschitz=model.lipschitz,
                multiplier=self.multiplier,
                decay_rate=requirements.decay_rate,
                squared_gain=self.squared_gain,
                block=cp.bmat,
            )
            self.constraints.append(bounded_real >> 0)
            if requirements.disk_radius is not None:
                disk = inequalities.disk(self.P, PA, radius=requirements.disk_radius, block=cp.bmat)
                self.constraints.append(disk >> 0)
        self.objective = self.squared_gain if gamma is None else self._energy(model, gain)

    def _energy(self, model: ErrorModel, gain: ObserverGain | None) -> cp.Expression:
        """trace(E^T P E) + trace((L V)^T P (L V)); the second one bounded by a slack where P L is free.

        Divided by 100, the order of its size in natural coordinates (rates of the observer, 1/s).
        """
        disturbances = cp.trace(model.E.T @ self.P @ model.E) / 100
        if gain is not None:
            return disturbances + sum(cp.trace((L @ model.V).T @ self.P @ (L @ model.V)) for L in gain.injections) / 100
        slack = cp.Variable((len(model.outputs),) * 2, symmetric=True)
        noise = inequalities.noise_energy(self.P, self.PL[0] @ model.V, slack, block=cp.bmat)
        self.constraints.append(noise >> 0)
        return disturbances + cp.trace(slack) / 100

    def solve(self) -> bool:
        """Whether there is a solution."""
        return solved(cp.Problem(cp.Minimize(self.objective), self.constraints))


def solved(problem: cp.Problem) -> bool:
    """Solve a program; whether it has a solution, perhaps inaccurate: what is made of it is proved or refused."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        try:
            problem.solve(solver=cp.CLARABEL, tol_gap_abs=TOLERANCE, tol_gap_rel=TOLERANCE, tol_feas=TOLERANCE)
        except cp.SolverError:
            return False
    return problem.status in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)


def value(expression: Any) -> Array:
    """Value of an expression after the program has been solved."""
    return np.asarray(expression.value, dtype=np.float64)


def _natural_coordinates(model: ErrorModel, decay_rate: float, gain: ObserverGain | None) -> tuple[Array, float]:
    """(T, size): in the coordinates T e, with z / size for z, P and gamma are of the order of one.

    There the error of the Kalman filter for disturbance and noise has the unit matrix for its covariance, or that of
    the given observer. Without this the optimum is wrong from the third digit on (in radians and metres P may be
    worse conditioned than the solver's arithmetic).

    Raises:
        DesignError: if no covariance is finite.
    """
    shifted = model.A[0] + decay_rate * np.eye(len(model.states))
    process, noise = model.E @ model.E.T, model.V @ model.V.T
    try:
        if gain is None:
            covariance = solve_continuous_are(shifted.T, model.C.T, process, noise)
        else:
            L = gain.injections[0]
            covariance = solve_continuous_lyapunov(shifted - L @ model.C, -(process + L @ noise @ L.T))
        T = np.linalg.cholesky(np.linalg.inv(covariance)).T
    except np.linalg.LinAlgError as error:
        raise DesignError(
            f"no estimate of all states decays at {decay_rate:g} 1/s; take a smaller decay_rate or a faster observer"
        ) from error
    return T, float(np.sqrt(np.linalg.eigvalsh(model.W @ covariance @ model.W.T)[-1]))


def _transformed(model: ErrorModel, T: Array, size: float) -> ErrorModel:
    """The model in the coordinates T e, with z / size for z."""
    inverse = np.linalg.inv(T)
    return dataclasses.replace(
        model,
        A=tuple(T @ A @ inverse for A in model.A),
        C=model.C @ inverse,
        D=T @ model.D,
        N=model.N @ inverse,
        E=T @ model.E,
        W=model.W @ inverse / size,
    )


def _proof(
    solution: Solution, gamma: float, optimum: float, requirements: Requirements, step_size: float, integrator: str
) -> Proof:
    return Proof(
        P=rounded_form(solution.P),
        multiplier=rounded(solution.multiplier, 6),
        gamma=gamma,
        gamma_optimum=rounded(optimum, 6),
        decay_rate=requirements.decay_rate,
        disk_radius=requirements.disk_radius,
        step_size=step_size,
        integrator=integrator,
    )


def _obstacle(model: ErrorModel, requirements: Requirements, **given: Any) -> str:
    """One sentence that says why there is no solution."""
    if solve(dataclasses.replace(model, lipschitz=0.0), requirements, **given) is None:
        if "gain" in given:
            return (
                f"no quadratic form proves a decay of {requirements.decay_rate:g} 1/s for these gains and their "
                "discrete step together; take a shorter step, smaller gains or a smaller decay_rate"
            )
        disk = f" with all poles in a disk of radius {requirements.disk_radius} 1/s" if requirements.disk_radius else ""
        return (
            f"no observer decays at {requirements.decay_rate:g} 1/s{disk}; take a larger disk_radius or a smaller "
            "decay_rate"
        )
    possible, impossible = 0.0, model.lipschitz
    while impossible - possible > 0.02 * impossible:
        middle = (possible + impossible) / 2
        if solve(dataclasses.replace(model, lipschitz=middle), requirements, **given) is None:
            impossible = middle
        else:
            possible = middle
    return (
        f"the Lipschitz constant {model.lipschitz:.3g} 1/s of the nonlinearity is larger than {possible:.3g} 1/s, the "
        "largest that can be certified; narrow the envelope, or ask for a faster observer"
    )
