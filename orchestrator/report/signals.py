"""Signals of a recording as figures need them: found by meaning, two-dimensional, with names of their channels."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.recording import Recording


def find(recording: Recording, key: str) -> NDArray[np.float64] | None:
    """The signal "component.port"; if there is no such component, the first one of any with that port."""
    port = key.partition(".")[2]
    candidates = [key, *(other for other in recording.signals if other.partition(".")[2] == port)]
    return next((two_dimensional(recording.signals[k]) for k in candidates if k in recording.signals), None)


def signal(recording: Recording, key: str) -> NDArray[np.float64] | None:
    """(N, size) signal "component.port", also of a scalar port; None if it is not recorded."""
    return two_dimensional(recording.signals[key]) if key in recording.signals else None


def two_dimensional(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) as (N, 1), (N, size) as it is."""
    return values.reshape(len(values), -1)


def channel_labels(recording: Recording, key: str) -> list[str]:
    """Name and unit of each element of a signal, e.g. "p (rad/s)".

    Names are those that the description ends with ("epsilon of (19): v_z, p, q, r"), else indices;
    of several units the last one holds for all further elements ("m/s, rad/s").
    """
    size = two_dimensional(recording.signals[key]).shape[1]
    listed = re.sub(r"\s*\([^()]*\)$", "", recording.descriptions.get(key, "")).split(", ")
    named = len(listed) == size > 1
    names = [listed[0].split(" ")[-1], *listed[1:]] if named else [f"[{i + 1}]" for i in range(size)]
    units = [pretty_unit(unit) for unit in recording.units.get(key, "").split(", ")]
    units += units[-1:] * (size - len(units))
    return [
        f"{subscript(name)} ({unit})" if unit else subscript(name) for name, unit in zip(names, units, strict=False)
    ]


def extent(*signals: NDArray[np.float64]) -> tuple[float, float]:
    """Range that shows all finite values with a little room around them."""
    finite = [values[np.isfinite(values)] for values in signals]
    lowest = min((float(values.min()) for values in finite if values.size), default=0.0)
    highest = max((float(values.max()) for values in finite if values.size), default=0.0)
    room = 0.06 * (highest - lowest) or max(0.1 * abs(highest), 0.01)
    return lowest - room, highest + room


def subscript(name: str) -> str:
    """ "v_z" with a real subscript."""
    return re.sub(r"_(\w+)$", r"<sub>\1</sub>", name) if re.fullmatch(r"\w_\w+", name) else name.replace("_", " ")


def pretty_unit(unit: str) -> str:
    """FMI's spelling of a unit as one prints it: "rad/s2" becomes "rad/s²", "1" nothing."""
    return "" if unit == "1" else unit.replace("2", "²").replace("3", "³").replace(".", "·")


def first_true(flags: NDArray[np.bool_]) -> int | None:
    """Index of the first set flag."""
    return int(np.argmax(flags)) if flags.any() else None
