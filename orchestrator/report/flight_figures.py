"""Figures of the flight itself: where the vehicle went and what its rotors did."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.report.axes import Cell, Figure, Trace, base_layout, line, rows_over_time
from rotordx.orchestrator.report.columns import Columns
from rotordx.orchestrator.report.events import Events
from rotordx.orchestrator.report.signals import extent, find

POINTS_OF_A_PATH = 2_000
PATH_HEIGHT = 480  #: px
LEAST_EXTENT = 0.4  #: of the widest one, for each side of the box around the path
SYMBOLS = {"fault": "diamond", "detected": "circle", "isolated": "square"}


def path(recording: Recording, columns: Columns, events: Events) -> Figure | None:
    """Flown and reference path in space, with the places where the fault set in and was noticed."""
    flown, reference = _positions(recording)
    if flown is None or not np.isfinite(flown).any():
        return None
    data = []
    if reference is not None:
        data.append(_path(columns, "reference", reference, "@muted", width=2, dash="dash"))
    onset = len(flown) if events.onset is None else int(np.searchsorted(recording.time, events.onset))
    data.append(_path(columns, "flown", flown[: onset + 1], "@blue", width=3))
    if onset + 1 < len(flown):
        data.append(_path(columns, "flown with the fault", flown[onset:], "@orange", width=3))
    for mark in events.marks():
        north, east, down = flown[np.searchsorted(recording.time[:-1], mark.time)]
        data.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "x": [float(north)],
                "y": [float(east)],
                "z": [float(-down)],
                "name": f"{mark.label} {mark.time:.3f} s",
                "marker": {"color": mark.colour, "size": 5, "symbol": SYMBOLS[mark.label]},
                "hovertemplate": "%{fullData.name}<extra></extra>",
            }
        )
    extents = np.array([np.ptp(extent(coordinate)) for coordinate in flown.T])
    sides = np.maximum(extents / extents.max(), LEAST_EXTENT).tolist()
    stretched = " Short sides of the box are stretched." if extents.min() < LEAST_EXTENT * extents.max() else ""
    layout = base_layout(PATH_HEIGHT) | {
        "margin": {"t": 0, "b": 0, "l": 0, "r": 0},
        "legend": {"orientation": "h", "x": 0, "y": 0, "yanchor": "bottom", "entrywidth": 135},
        "scene": {
            "xaxis": {"title": {"text": "north (m)"}},
            "yaxis": {"title": {"text": "east (m)"}, "autorange": "reversed"},
            "zaxis": {"title": {"text": "altitude (m)"}, "nticks": 4},
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", sides, strict=True)),
            "camera": {"eye": {"x": -1.5, "y": 0.95, "z": 0.8}, "center": {"x": 0, "y": 0, "z": -0.12}},
        },
    }
    return Figure("path", "Flight path", f"Drag to turn, scroll to zoom.{stretched}", data, layout)


def tracking(recording: Recording, columns: Columns, clock: str, events: Events) -> Figure | None:
    """Position error along north, east and down."""
    flown, reference = _positions(recording)
    if flown is None or reference is None or not np.isfinite(flown).any():
        return None
    rows = []
    for i, direction in enumerate(("north", "east", "down")):
        error = 100 * (flown[:, i] - reference[:, i])
        column = columns.add(clock, f"position error {direction}", error)
        rows.append(Cell([line(clock, column, "position error", "@blue")], extent(error), y_title=f"{direction} (cm)"))
    data, layout = rows_over_time(rows, replace(events, window=None), row_height=115)
    layout["showlegend"] = False
    return Figure("tracking", "Position error", "Flown position less its reference.", data, layout)


def rotor_speeds(recording: Recording, columns: Columns, clock: str, events: Events) -> Figure | None:
    """Commanded and actual speed of each rotor."""
    command, actual = find(recording, "controller.rotor_speed_command"), find(recording, "esc.rotor_speed")
    if command is None:
        return None
    rows = []
    for i in range(command.shape[1]):
        column = columns.add(clock, f"commanded rotor speed {i + 1}", command[:, i])
        traces, y_range = [line(clock, column, "commanded", "@orange", width=1)], extent(command[:, i])
        if actual is not None:
            column = columns.add(clock, f"actual rotor speed {i + 1}", actual[:, i])
            traces.append(line(clock, column, "actual", "@blue"))
            y_range = extent(command[:, i], actual[:, i])
        rows.append(Cell(traces, y_range, y_title=f"rotor {i + 1} (rad/s)"))
    data, layout = rows_over_time(rows, events, row_height=100)
    caption = (
        "What the controller asked for and what the motors did: a weaker rotor is driven faster, but turns slower."
    )
    return Figure("rotor-speeds", "Rotor speeds", caption, data, layout, min_width=640)


def _positions(recording: Recording) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """(N, 3) flown and reference positions, NED."""
    return find(recording, "plant.position"), find(recording, "reference.position_reference")


def _path(columns: Columns, name: str, position: NDArray[np.float64], colour: str, **style: object) -> Trace:
    """Line in space through (N, 3) NED positions. Whole samples are left out: extremes of x, y, z do not belong
    together."""
    drawn = position[:: max(1, len(position) // POINTS_OF_A_PATH)]
    x, y, z = (columns.add_exactly(f"{name} {axis}", drawn[:, i]) for i, axis in enumerate("xyz"))
    return {
        "type": "scatter3d",
        "mode": "lines",
        "x": x,
        "y": y,
        "z": f"-{z}",
        "name": name,
        "line": {"color": colour, **style},
        "hovertemplate": "north %{x:.3f} m<br>east %{y:.3f} m<br>altitude %{z:.3f} m<extra>%{fullData.name}</extra>",
    }
