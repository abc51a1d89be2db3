"""What random sensor noise leaves in the rms of a residual over a window, and a bound on it with a stated probability.

A residual nu that is linear in the noise makes J^2, the mean of |nu|^2 over a window, a quadratic form of unit normal
numbers. With its eigenvalues a_i (Laurent, Massart 2000, Lemma 1),

    P(J^2 >= sum a + 2 r |a|_2 + 2 r^2 max a) <= exp(-r^2)

Its component along anything that is not random is normal, with a variance of at most max a:

    P(<s, n> >= |s| r (2 max a)^1/2) <= exp(-r^2)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles.parameters import SensorParameters
from rotordx.gains.margins import Responses
from rotordx.gains.rounding import rounded
from rotordx.gains.theory import Theory

Array = NDArray[np.float64]

#: A response is over once what remains of it has less than this part of its energy.
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class NoiseModel:
    """Eigenvalues of the quadratic form, as far as they matter."""

    energies: Any  #: (3,) their sum, the root of the sum of their squares, the largest one; rad2/s2


@dataclass(frozen=True)
class NoiseGain:
    """Parts of the threshold that stand for the noise."""

    noise_rms: float  #: rad/s
    noise_projection: float  #: rad/s


@dataclass(frozen=True)
class NoiseProof:
    """How improbable it is that the noise exceeds one of them."""

    root_exponent: float  #: r: the probability is at most 2 exp(-r^2)


def energies(responses: Responses, sensors: SensorParameters, window: float) -> Array:
    """Energies (3) of a residual, from its responses to the noise of each sample.

    Noise of the gyro is white, that of captured attitude and position is held until the next capture.
    """
    held = max(1, round(sensors.motion_capture_period / responses.step_size))
    samples = round(window / responses.step_size)
    noises = (
        (responses.gyro * sensors.gyro_noise_std, 1),
        (responses.attitude * sensors.motion_capture_attitude_noise_std, held),
        (responses.position * sensors.motion_capture_position_noise_std, held),
    )
    effects = np.hstack([_effects(response, count, samples) for response, count in noises])
    eigenvalues = np.linalg.eigvalsh(effects @ effects.T) / samples
    return rounded(np.array([eigenvalues.sum(), np.linalg.norm(eigenvalues), eigenvalues.max()]), 10)


def _effects(response: Array, held: int, samples: int) -> Array:
    """What each independent noise (columns) adds to the residuals of the window (rows: samples by channels)."""
    remaining = np.cumsum((response**2).sum(axis=(1, 2))[::-1])[::-1]
    memory = int(np.argmax(remaining <= NEGLIGIBLE * remaining[0])) or len(response)
    padded = np.concatenate((np.zeros((samples, *response.shape[1:])), response[:memory], np.zeros_like(response)))
    columns = []
    for first in range(-memory - held, samples, held):  # sample of the window at which a noise begins, and is held
        starts = range(first, first + held)
        columns.append(sum(padded[samples - start : 2 * samples - start] for start in starts if start < samples))
    stacked = np.stack(columns)  # (noises, samples, channels, sources)
    return np.moveaxis(stacked, 0, 2).reshape(samples * response.shape[1], -1)


def quantiles(values: Any, root_exponent: float) -> tuple[float, float]:
    """(rms value, component along a given course) of noise with given energies (3), each exceeded at exp(-r^2)."""
    rms, projection = squared_quantiles(values, root_exponent)
    return float(np.sqrt(rms)), float(np.sqrt(projection))


def squared_quantiles(values: Any, root_exponent: Any) -> tuple[Any, Any]:
    """noise_rms^2 > sum a + 2 r |a|_2 + 2 r^2 max a, noise_projection^2 > 2 r^2 max a.

    a are the eigenvalues of J_nu^2 as a quadratic form of unit normal noise (Laurent, Massart 2000).
    """
    along = 2 * root_exponent * root_exponent * values[2]
    return values[0] + 2 * root_exponent * values[1] + along, along


def _inequalities(model: NoiseModel, gain: NoiseGain, proof: NoiseProof) -> dict[str, Any]:
    rms, projection = squared_quantiles(model.energies, proof.root_exponent)
    return {
        "noise in the window": np.array([[gain.noise_rms * gain.noise_rms - rms]]),
        "noise along a course": np.array([[gain.noise_projection * gain.noise_projection - projection]]),
    }


def _figures(model: NoiseModel, gain: NoiseGain, proof: NoiseProof) -> dict[str, Any]:
    return {
        "mean_rms": float(np.sqrt(model.energies[0])),
        "quantiles": list(quantiles(model.energies, proof.root_exponent)),
        "probability": float(2 * np.exp(-(proof.root_exponent**2))),
    }


NOISE = Theory(
    name="noise",
    statement=(
        "Random sensor noise alone leaves more than noise_rms in J_nu, or more than noise_projection along a given "
        "course, with a probability of at most 2 exp(-root_exponent^2) in any one window. These quantiles stand in "
        "J_th for the amplitude d of the noise in Theorem 1."
    ),
    model=NoiseModel,
    proof=NoiseProof,
    inequalities=_inequalities,
    figures=_figures,
    formulas=(squared_quantiles,),
)
