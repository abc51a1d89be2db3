"""Proofs about observers with output injection: gain, decay, disk, and the discrete step, by one quadratic form."""

from __future__ import annotations

from typing import Any

import numpy as np

from rotordx.gains import analysis, inequalities
from rotordx.gains.discretisation import require_stable, spectral_radius, step_matrix
from rotordx.gains.error_model import ErrorModel, ObserverGain
from rotordx.gains.fault_models import ObserverOptions
from rotordx.gains.options import POSITIVE, option
from rotordx.gains.synthesis import Proof, Requirements, best_proof
from rotordx.gains.theory import Subject, Theory


def proof_inequalities(model: ErrorModel, gain: ObserverGain, proof: Proof) -> dict[str, Any]:
    """Matrices that must be positive definite; the corners (of model and gain) share P."""
    P = proof.P
    matrices = {"Lyapunov matrix": P, "multiplier": np.array([[proof.multiplier]])}
    for corner, loop in enumerate(model.close(gain), start=1):
        PA = P @ loop.A
        matrices[f"bounded real, corner {corner}"] = inequalities.bounded_real(
            P,
            PA,
            P @ loop.B,
            P @ loop.D,
            loop.N,
            loop.C,
            loop.F,
            lipschitz=loop.lipschitz,
            multiplier=proof.multiplier,
            decay_rate=proof.decay_rate,
            squared_gain=proof.gamma**2,
        )
        if proof.disk_radius is not None:
            matrices[f"disk, corner {corner}"] = inequalities.disk(P, PA, radius=proof.disk_radius)
        if proof.integrator != "exact":  # whose step contracts P because the differential equation does
            step = step_matrix(loop.A, proof.step_size, proof.integrator)
            matrices[f"discrete step, corner {corner}"] = inequalities.contraction(P, step)
    return matrices


def figures(model: ErrorModel, gain: ObserverGain, proof: Proof) -> dict[str, Any]:
    """Figures of the closed loops, the worst of all corners; noise and settling of the estimates in the first corner.

    Estimates are the faults, or the state where no fault is estimated.

    Raises:
        LinAlgError: if the observer is unstable, and nothing is finite.
    """
    loops = list(model.close(gain))
    estimates = model.faults if "fault" in model.states[-1] else slice(0, len(model.states))
    poles = np.concatenate([np.linalg.eigvals(loop.A) for loop in loops])
    steps = [step_matrix(loop.A, proof.step_size, proof.integrator) for loop in loops]
    radius = max(spectral_radius(step) for step in steps)
    if poles.real.max() >= 0 or radius >= 1:
        raise np.linalg.LinAlgError("the observer is unstable")
    noise = analysis.noise_std(loops[0], model.disturbances, proof.step_size, proof.integrator)
    return {
        "gamma_without_nonlinearity": max(analysis.hinf_norm(loop.A, loop.B, loop.C, loop.F) for loop in loops),
        "gamma_per_axis": {
            axis: max(analysis.hinf_norm(loop.A, loop.B, rows @ loop.C, rows @ loop.F) for loop in loops)
            for axis, rows in analysis.axis_outputs(model).items()
        },
        "slowest_pole": float(poles.real.max()),
        "fastest_pole": float(poles.real.min()),
        "spectral_radius": radius,
        "condition_number": float(np.linalg.cond(proof.P)),
        "estimates": list(model.states[estimates]),
        "noise_std": (noise[estimates] / np.diag(model.W)[estimates]).tolist(),
        "settling_time": analysis.settling_times(steps[0], loops[0].C[estimates], estimates, proof.step_size),
    }


def limits(proof: Proof, figures: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """The gain without nonlinearity, found by other means, cannot exceed the proved one; a stable step contracts."""
    return {
        "gain by Hamiltonian bisection": (figures["gamma_without_nonlinearity"], proof.gamma),
        "spectral radius of the step": (figures["spectral_radius"], 1.0),
        "gamma over its optimum": (proof.gamma / proof.gamma_optimum, 1.05 * (1 + 1e-5)),
    }


OBSERVER = Theory(
    name="observer",
    statement=(
        "For every nonlinearity within the Lipschitz constant the estimation error decays at decay_rate or faster, and "
        "the gain from w (disturbances or rates of the faults, measurement noise) to z (weighted errors) is at most "
        "gamma; if there is a disk, all poles are in it; the discrete step contracts the same quadratic form."
    ),
    model=ErrorModel,
    proof=Proof,
    inequalities=proof_inequalities,
    figures=figures,
    formulas=(inequalities.bounded_real, inequalities.disk, inequalities.contraction),
    limits=limits,
)


def decay_rate_option() -> Any:
    """The option `decay_rate` of designs with gains in closed form."""
    return option(2.0, "1/s", "alpha that is proved: errors decay at least as exp(-alpha t)", minimum=POSITIVE)


def prove(subject: Subject, decay_rate: float, options: ObserverOptions, remedy: str) -> Proof:
    """Proof for a given gain, after its discrete step has been checked.

    Args:
        subject: model and gain.
        decay_rate: to be proved, 1/s.
        options: step size and integrator.
        remedy: what to take if the step is unstable.

    Raises:
        DesignError: if the step is unstable, or nothing can be proved for the Lipschitz constant.
    """
    for loop in subject.model.close(subject.gain):
        require_stable(loop.A, options.step_size, options.integrator, remedy)
    requirements = Requirements(decay_rate=decay_rate, disk_radius=None)
    return best_proof(subject.model, subject.gain, requirements, options.step_size, options.integrator)
