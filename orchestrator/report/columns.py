"""Columns of numbers in a report: collected from the figures, decimated, encoded once each."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.report.decimation import bucket_starts, bucket_times, envelope

POINTS_OF_ALL_COLUMNS = 120_000  #: 0.64 MB as float32 in base64, beside the 4.8 MB of plotly.js
POINTS_OF_A_COLUMN = 1_500  #: more than a screen has pixels, few enough to be drawn at once


@dataclass(frozen=True)
class Clock:
    """The instants at which some columns are drawn: from `first` on, most densely in `focus` (sample indices)."""

    first: int
    focus: tuple[int, int] | None
    columns: dict[str, NDArray[np.float64]] = field(default_factory=dict)


@dataclass(frozen=True)
class Columns:
    """What figures refer to, by names that start with "$", instead of holding numbers."""

    time: NDArray[np.float64]
    clocks: dict[str, Clock] = field(default_factory=dict)
    exact: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def clock(self, name: str, window: tuple[float, float] | None, start: float | None = None) -> str:
        """Reference to new instants, from `start` (s) to the end, with detail in the window (s)."""
        first = 0 if start is None else int(np.searchsorted(self.time, start))
        focus = None
        if window is not None:
            begin, end = np.searchsorted(self.time, window)
            focus = (int(begin) - first, int(end) - first)
        self.clocks[f"${name}"] = Clock(first, focus)
        return f"${name}"

    def add(self, clock: str, name: str, values: NDArray[np.float64]) -> str:
        """Reference to (N,) values, one for each sample, which are decimated at the clock."""
        reference = f"{clock}: {name}"
        self.clocks[clock].columns[reference] = values
        return reference

    def add_exactly(self, name: str, values: NDArray[np.float64]) -> str:
        """Reference to values that are drawn as they are."""
        self.exact[f"${name}"] = values
        return f"${name}"

    def encode(self) -> dict[str, dict[str, str]]:
        """All columns as little-endian typed arrays in base64; they share one budget of points."""
        count = sum(len(clock.columns) for clock in self.clocks.values())
        points = min(POINTS_OF_A_COLUMN, POINTS_OF_ALL_COLUMNS // max(count, 1))
        encoded = {name: _encode(values, "float32") for name, values in self.exact.items()}
        for name, clock in self.clocks.items():
            if not clock.columns:
                continue
            starts = bucket_starts(len(self.time) - clock.first, points, clock.focus)
            encoded[name] = _encode(bucket_times(self.time[clock.first :], starts), "float64")
            drawn = envelope(np.column_stack([values[clock.first :] for values in clock.columns.values()]), starts)
            encoded.update((column, _encode(drawn[:, i], "float32")) for i, column in enumerate(clock.columns))
        return encoded


def _encode(values: NDArray[np.floating], dtype: str) -> dict[str, str]:
    little_endian = np.ascontiguousarray(values, dtype=np.dtype(dtype).newbyteorder("<"))
    return {"dtype": dtype, "base64": base64.b64encode(little_endian.tobytes()).decode("ascii")}
