"""What a flight or a replay leaves behind: every logged signal over time, with its unit and its origin."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SignalInfo:
    """One logged port: a scalar (`shape` is None) or an array of `shape` elements, SI units."""

    key: str  #: "component.port"
    unit: str
    description: str
    shape: int | None = None

    @property
    def width(self) -> int:
        """Number of columns that the port takes in a log."""
        return 1 if self.shape is None else self.shape


@dataclass(frozen=True)
class Recording:
    """Signals of one flight or replay, and what they came from; all values in SI units."""

    time: NDArray[np.float64]  #: (N,) s, t = k h
    signals: dict[str, NDArray[np.float64]]  #: "component.port" -> (N,) of a scalar port, (N, size) of an array port
    units: dict[str, str]  #: same keys as `signals`
    descriptions: dict[str, str]  #: same keys as `signals`
    scenario: dict[str, Any]  #: the validated scenario (or the settings of a replay) as plain data
    faults: list[dict[str, Any]] = field(default_factory=list)  #: rotor, onset_s, loss_of_effectiveness, profile
    diagnosers: list[str] = field(default_factory=list)  #: component names of the diagnosers
    #: wall_time_s, real_time_factor, step_time_ns (a dict over the diagnosers), messages (log lines of the FMUs)
    measurements: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def from_log(
        cls,
        time: NDArray[np.float64],
        log: NDArray[np.float64],
        logged: Iterable[SignalInfo],
        **origin: Any,
    ) -> Recording:
        """Recording of a flat log.

        Args:
            time: (N,) s.
            log: (N, sum of widths), one column per port element in the order of `logged`; the signals are views of it.
            logged: the ports in the order of their columns.
            origin: the remaining fields (scenario, faults, diagnosers, measurements).

        Raises:
            ValueError: the log's width is not the sum of the ports' widths.
        """
        logged = list(logged)
        return cls(
            time=time,
            signals=split_columns(log, logged),
            units={info.key: info.unit for info in logged},
            descriptions={info.key: info.description for info in logged},
            **origin,
        )


def split_columns(log: NDArray[np.float64], logged: Iterable[SignalInfo]) -> dict[str, NDArray[np.float64]]:
    """Views of a (N, width) log by port: (N,) for a scalar port, (N, size) for an array port."""
    signals, column = {}, 0
    for info in logged:
        signals[info.key] = log[:, column] if info.shape is None else log[:, column : column + info.width]
        column += info.width
    if column != log.shape[1]:
        raise ValueError(f"the log has {log.shape[1]} columns, its ports take {column}")
    return signals
