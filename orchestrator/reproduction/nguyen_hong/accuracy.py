"""How well and how soon the thrust that a motor lacks is estimated: what the Thau observers are judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.reproduction.motor_offsets import missing_thrust, offsets_if_alone
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System

Array = NDArray[np.float64]

#: an estimate has settled when it stays within so much of the final offset
SETTLED = 0.05

#: s after the onset in which it has to settle, and from when on bias and spread count
ONSET_WINDOW, STEADY_AFTER = 0.5, 2.0


@dataclass(frozen=True)
class Accuracy:
    """How well the offset of the rotor that fails first is estimated in one flight."""

    settling_time: float  #: s after the onset, from when on the estimate stays within 5 % of the offset
    bias: float  #: relative to the offset
    std: float  #: N
    offset: float  #: N, mean in the steady state


def accuracy(recording: Recording, diagnoser: str) -> Accuracy:
    """Of the estimate for the rotor that fails first, as if it alone failed."""
    rotor, onset = recording.faults[0]["rotor"] - 1, recording.faults[0]["onset_s"]
    truth = missing_thrust(recording)[:, rotor]
    error = offsets_if_alone(recording, diagnoser)[:, rotor] - truth
    steady = recording.time >= onset + STEADY_AFTER
    offset = float(truth[steady].mean())
    begins = (recording.time > onset) & (recording.time <= onset + ONSET_WINDOW)
    off = recording.time[begins][np.abs(error[begins]) > SETTLED * abs(offset)]
    settling_time = float(off[-1] - onset) if len(off) else 0.0
    return Accuracy(settling_time, float(error[steady].mean()) / offset, float(error[steady].std()), offset)


@dataclass(frozen=True)
class Repetitions:
    """Figures of noisy repetitions of one experiment with one diagnoser."""

    settling_time: Array  #: s
    bias: Array  #: relative
    std: Array  #: N
    detection_delay: Array  #: s, infinite if there was no detection
    named: Array  #: rotor

    def text(self) -> str:
        """The worst of all."""
        return (
            f"within 5 % after {1000 * self.settling_time.max():.0f} ms, bias {100 * np.abs(self.bias).max():.2f} %, "
            f"spread {self.std.max():.3f} N (worst of {len(self.bias)})"
        )


def repeated(scenario: Scenario, seeds: int, flown: Callable[[], None]) -> dict[str, Repetitions]:
    """Fly an experiment with several seeds; diagnoser -> its figures.

    Args:
        flown: called after every flight.
    """
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in scenario.diagnosers}
    with System(scenario) as system:
        for seed in range(seeds):
            recording = fly(scenario.changed(seed=seed), system)
            verdicts = summarise(recording)["diagnosers"]
            for name, found in rows.items():
                a, verdict = accuracy(recording, name), verdicts[name]
                delay = verdict["detection_delay_s"]
                missed = float("inf") if delay is None else delay
                found.append((a.settling_time, a.bias, a.std, missed, verdict["faulty_rotor"]))
            flown()
    return {name: Repetitions(*np.array(found, dtype=float).T) for name, found in rows.items()}
