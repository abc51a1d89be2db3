"""Paper 002's world: four linear channels behind a motor lag, each with one fault coefficient, and both filters on it.

A channel has the states position, rate and actuator output u_act, A_c = [0 1 0; 0 0 1/J; 0 0 -w], B_c = [0; 0; w gain],
held inputs; a fault takes gamma u from the input. All states are measured (R is a multiple of I). The paper gives no
inertia, sampling time, input or length: J = 1, 10 ms, a sine of amplitude 1 and 1 Hz, 400 samples are taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from rotordx.orchestrator.reproduction.msjfo import filter_costs as forms

Array = NDArray[np.float64]

CHANNELS = ("heave", "pitch", "roll", "yaw")
MOTOR_GAIN, BANDWIDTH, ARM, TORQUE_GAIN = 1.0, 10.0, 0.2, 0.1
GAINS = MOTOR_GAIN * np.array([1.0, ARM, ARM, TORQUE_GAIN])
INERTIA, STEP_SIZE, SAMPLES, INPUT_RATE = 1.0, 0.01, 400, 2 * np.pi
PROCESS_NOISE, MEASUREMENT_NOISE = 0.01, 0.1  #: variances as printed
JUMP = 200  #: sample of scenario 3
SETTLED = 100  #: samples until steady figures are taken

N, M, P = 3, 1, 3


@dataclass(frozen=True)
class Experiment:
    """One of the paper's scenarios."""

    name: str
    losses: tuple[float, float, float, float]
    loss_noise: float  #: Q_gamma of filter and truth
    jump: bool = False  #: the losses are 0 until sample `JUMP`

    def first(self) -> Array:
        """Losses (4) at the start."""
        return np.zeros(4) if self.jump else np.array(self.losses)


EXPERIMENTS = (
    Experiment("1", (0.2,) * 4, 0.0),
    Experiment("2", (0.2, 0.3, 0.4, 0.5), 1e-4),
    Experiment("3", (0.2, 0.3, 0.4, 0.5), 1e-4, jump=True),
)


@dataclass(frozen=True)
class Outcome:
    """An experiment, repeated; arrays are (samples, seeds, channels) and errors estimate less truth."""

    truth: Array
    loss: Array  #: as `msjfo` estimates it
    state_error: Array  #: (samples, seeds, channels, 3)
    measurement_error: Array  #: the same
    difference_from_askf: float  #: largest, of losses and states
    innovation: Array  #: normalised innovation squared per measurement


def channel_matrices(gain: float) -> tuple[Array, Array]:
    """A (3, 3) and B (3,) of a channel over one sample."""
    continuous = np.zeros((4, 4))
    continuous[0, 1], continuous[1, 2] = 1.0, 1 / INERTIA
    continuous[2, 2:] = -BANDWIDTH, BANDWIDTH * gain
    step = expm(continuous * STEP_SIZE)
    return step[:3, :3], step[:3, 3]


def run(
    experiment: Experiment,
    scale: float,
    seeds: int,
    *,
    amplitude: float = 1.0,
    walking: bool = True,
) -> Outcome:
    """Repeat an experiment with many seeds at once.

    Args:
        scale: factor on the printed variances of process and measurement, in truth and filters alike.
        amplitude: of the input.
        walking: the true losses walk with Q_gamma, as the paper's model says; false: they stand still.
    """
    rng = np.random.default_rng(2)
    count = seeds * len(CHANNELS)
    A, B = (np.stack(parts) for parts in zip(*map(channel_matrices, np.tile(GAINS, seeds)), strict=True))
    Q, R = PROCESS_NOISE * scale, MEASUREMENT_NOISE * scale
    x, gamma = np.zeros((count, N)), np.tile(experiment.first(), seeds)
    filters = _Filters(A, B, Q, R, experiment.loss_noise)
    records: dict[str, list[Array]] = {name: [] for name in ("truth", "loss", "state", "measured", "innovation")}
    difference = 0.0
    for k in range(SAMPLES):
        if experiment.jump and k == JUMP:
            gamma = gamma + np.tile(experiment.losses, seeds)
        u = amplitude * np.sin(INPUT_RATE * STEP_SIZE * (k + 0.5))
        noise = np.sqrt(Q) * rng.normal(size=x.shape)
        x = np.einsum("cij,cj->ci", A, x) + B * (u * (1 - gamma))[:, None] + noise
        if walking:
            gamma = gamma + np.sqrt(experiment.loss_noise) * rng.normal(size=count)
        error = np.sqrt(R) * rng.normal(size=x.shape)
        state, loss, innovation, disagreement = filters.step(u, x + error)
        difference = max(difference, disagreement)
        for name, value in zip(records, (gamma, loss, state - x, error, innovation), strict=True):
            records[name].append(value)
    shaped = {name: np.array(rows).reshape(SAMPLES, seeds, len(CHANNELS), -1) for name, rows in records.items()}
    return Outcome(
        shaped["truth"][..., 0],
        shaped["loss"][..., 0],
        shaped["state"],
        shaped["measured"],
        difference,
        shaped["innovation"][..., 0],
    )


class _Filters:
    """`msjfo` and `askf` on all channels of all seeds at once, from x = 0, gamma = 0, P = I."""

    def __init__(self, A: Array, B: Array, Q: float, R: float, loss_noise: float):
        self.count = len(A)
        self._A, self._B = np.hstack(list(A)), B.T
        packed = np.eye(N)[np.tril_indices(N)]
        self._noise = [np.tile(np.atleast_1d(v)[:, None], self.count) for v in (Q * packed, loss_noise, np.full(P, R))]
        self._C = np.tile(np.eye(P), self.count)
        self._augmented = forms.augmented(N, M, P).map(self.count)
        self._staged = forms.staged(N, M, P).map(self.count)
        one = np.ones((1, self.count))
        start = np.eye(N + M)[np.tril_indices(N + M)]
        self._joint = [np.zeros((N + M, self.count)), start[:, None] * one]
        self._stages = [np.zeros((N, self.count)), packed[:, None] * one, 0 * one, one, np.zeros((N, self.count))]

    def step(self, u: float, measured: Array) -> tuple[Array, Array, Array, float]:
        """States (count, 3), losses (count,), normalised innovation squared, largest difference of the two."""
        model = [self._A, self._B * u, -self._B * u, self._C, *self._noise, measured.T]
        *self._joint, _ = (np.array(v) for v in self._augmented(*self._joint, *model))
        *self._stages, innovation = (np.array(v) for v in self._staged(*self._stages, *model))
        x, _, gamma, _, V = self._stages
        state = x + V * gamma
        difference = np.abs(np.vstack((state, gamma)) - self._joint[0]).max()
        return state.T, gamma[0], (innovation**2).mean(axis=0), float(difference)


def printed_sign_error(seeds: int = 4) -> float:
    """Largest error of a loss in scenario 2 when A^1 is taken as printed, with +B u and without the known input."""
    experiment = EXPERIMENTS[1]
    rng = np.random.default_rng(2)
    worst = 0.0
    for gain, loss in zip(GAINS, experiment.losses, strict=True):
        A, B = channel_matrices(gain)
        for _ in range(seeds):
            x, step = np.zeros(N), forms.augmented(N, M, P)
            joint, covariance = np.zeros(N + M), np.eye(N + M)[np.tril_indices(N + M)]
            for k in range(SAMPLES):
                u = np.sin(INPUT_RATE * STEP_SIZE * (k + 0.5))
                x = A @ x + B * u * (1 - loss) + 1e-2 * np.sqrt(PROCESS_NOISE) * rng.normal(size=N)
                y = x + 1e-2 * np.sqrt(MEASUREMENT_NOISE) * rng.normal(size=N)
                noise = (1e-4 * PROCESS_NOISE * np.eye(N)[np.tril_indices(N)], experiment.loss_noise)
                R = np.full(P, 1e-4 * MEASUREMENT_NOISE)
                joint, covariance, _ = step(joint, covariance, A, np.zeros(N), B * u, np.eye(P), *noise, R, y)
            worst = max(worst, abs(float(ca.DM(joint)[N]) - loss))
    return worst
