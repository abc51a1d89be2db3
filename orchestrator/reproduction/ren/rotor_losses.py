"""Losses of effectiveness of all rotors, as diagnosers estimate them in flight: what fault observers are judged by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.reproduction.motor_offsets import healthy_thrust, offsets_if_alone
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System

Array = NDArray[np.float64]

#: an estimate has settled when it stays within so much of the loss
SETTLED = 0.05

#: s after the onset, from when on bias and spread count
STEADY_AFTER = 2.0


def losses(recording: Recording, diagnoser: str) -> Array:
    """Loss of each rotor (N, 4): all four estimated, or, where three torques are, each as if it alone were faulty."""
    signals = recording.signals
    if f"{diagnoser}.rotor_loss" in signals and signals[f"{diagnoser}.isolation_model"][-1] == 4:
        return signals[f"{diagnoser}.rotor_loss"]
    return np.asarray(-offsets_if_alone(recording, diagnoser) / healthy_thrust(recording))


def state_errors(recording: Recording, diagnoser: str) -> Array:
    """Estimated less true roll, pitch, yaw, p, q, r (N, 6), rad and rad/s."""
    pairs = (("euler", "euler_estimate"), ("body_rate", "body_rate_estimate"))
    return np.hstack([recording.signals[f"{diagnoser}.{e}"] - recording.signals[f"plant.{t}"] for t, e in pairs])


@dataclass(frozen=True)
class Accuracy:
    """How well the losses are estimated over many flights that differ in their noise."""

    rotor: int  #: that fails, counted from 0
    settling_time: float  #: s after the onset, from when on the mean of all flights stays within 5 % of the loss
    mean_error: Array  #: of each rotor, in the steady state (4,)
    spread: Array  #: of the estimates of one flight about their mean (4,)
    rms: float  #: error of the rotor that fails, from the onset on

    @property
    def bias(self) -> float:
        """Mean error of the rotor that fails."""
        return float(self.mean_error[self.rotor])

    @property
    def std(self) -> float:
        """Spread of the rotor that fails."""
        return float(self.spread[self.rotor])

    @property
    def ghost(self) -> float:
        """Largest mean error of the healthy rotors; says nothing where each rotor is taken to fail alone."""
        return float(np.abs(np.delete(self.mean_error, self.rotor)).max())

    def text(self) -> str:
        """In words."""
        return f"within 5 % after {1000 * self.settling_time:.0f} ms, bias {self.bias:+.4f}, spread {self.std:.4f}"


class Flown:
    """Adds up the flights of one experiment for one diagnoser."""

    def __init__(self, diagnoser: str):
        self._diagnoser, self._count = diagnoser, 0
        self._sum: Array | float = 0.0
        self._variance: Array | float = 0.0
        self._square: Array | float = 0.0
        self._last: Recording | None = None

    def add(self, recording: Recording) -> None:
        """One more flight."""
        estimate = losses(recording, self._diagnoser)
        onset = recording.faults[0]["onset_s"]
        truth = recording.signals["esc.loss_of_effectiveness"]
        error = estimate - truth
        self._count, self._last = self._count + 1, recording
        self._sum = self._sum + error
        self._variance = self._variance + error[recording.time >= onset + STEADY_AFTER].var(axis=0)
        self._square = self._square + (error[recording.time >= onset] ** 2).mean(axis=0)

    def accuracy(self) -> Accuracy:
        """Of all flights."""
        assert self._last is not None, "nothing was flown"
        fault, time = self._last.faults[0], self._last.time
        rotor, onset = fault["rotor"] - 1, fault["onset_s"]
        error = np.asarray(self._sum / self._count)
        loss = float(self._last.signals["esc.loss_of_effectiveness"][-1, rotor])
        off = time[(time >= onset) & (np.abs(error[:, rotor]) > SETTLED * loss)]
        return Accuracy(
            rotor=rotor,
            settling_time=float(off[-1] - onset) if len(off) else 0.0,
            mean_error=error[time >= onset + STEADY_AFTER].mean(axis=0),
            spread=np.sqrt(np.asarray(self._variance) / self._count),
            rms=float(np.sqrt(np.asarray(self._square)[rotor] / self._count)),
        )


def repeated(
    scenario: Scenario,
    diagnosers: Sequence[str],
    seeds: int,
    flown: Callable[[Recording], None],
    system: System | None = None,
) -> dict[str, Accuracy]:
    """Fly an experiment with several seeds; diagnoser -> how well it estimates.

    Args:
        flown: called after every flight.
        system: one to use again.
    """
    found = {name: Flown(name) for name in diagnosers}
    if system is None:
        with System(scenario) as own:
            return repeated(scenario, diagnosers, seeds, flown, own)
    for i in range(seeds):
        recording = fly(scenario.changed(seed=scenario.seed + i), system)
        for each in found.values():
            each.add(recording)
        flown(recording)
    return {name: each.accuracy() for name, each in found.items()}
