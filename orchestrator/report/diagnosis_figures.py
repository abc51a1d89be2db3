"""Figures of a diagnoser's work: detection, isolation, estimation; each only if its signals were recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator import metrics
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.report.axes import Cell, Figure, Trace, band, grid_over_time, line, rows_over_time
from rotordx.orchestrator.report.columns import Columns
from rotordx.orchestrator.report.events import Events, Mark
from rotordx.orchestrator.report.signals import channel_labels, extent, first_true, signal

ROTOR_COLOURS = ("@blue", "@orange", "@green", "@purple")
THRESHOLD = {"dash": "dash", "width": 1.2}
HEADROOM = 2.5  #: how many times its threshold a residual is shown in the small multiples


def detection(recording: Recording, diagnoser: str, columns: Columns, clock: str, events: Events) -> Figure | None:
    """Every residual between its adaptive thresholds (Avram et al., figure 7)."""
    residual, threshold = (signal(recording, f"{diagnoser}.{port}") for port in ("residual", "threshold"))
    if residual is None:
        return None
    rows = []
    for j, label in enumerate(channel_labels(recording, f"{diagnoser}.residual")):
        traces, y_range = [], extent(residual[:, j])
        if threshold is not None:
            y_range = extent(residual[:, j], threshold[:, j], -threshold[:, j])
            bound = columns.add(clock, f"{diagnoser}.threshold[{j + 1}]", threshold[:, j])
            traces += band(clock, f"-{bound}", bound, "± threshold", "@red", **THRESHOLD)
        column = columns.add(clock, f"{diagnoser}.residual[{j + 1}]", residual[:, j])
        rows.append(Cell([*traces, line(clock, column, "residual", "@blue")], y_range, y_title=label))
    data, layout = rows_over_time(rows, events, row_height=112)
    caption = "A fault is detected as soon as one residual leaves the band between its thresholds."
    return Figure(f"{diagnoser}-detection", "Detection", caption, data, layout, min_width=640)


def isolation(recording: Recording, diagnoser: str, columns: Columns, events: Events) -> Figure | None:
    """Residuals of the isolation estimators between their thresholds around the detection (Avram et al., figure 8)."""
    residual, threshold = (signal(recording, f"{diagnoser}.isolation_{port}") for port in ("residual", "threshold"))
    if residual is None or threshold is None or events.detection is None or events.window is None:
        return None
    labels = channel_labels(recording, f"{diagnoser}.residual")
    window = (max(events.detection - 0.5, float(recording.time[0])), events.window[1])
    clock = columns.clock(f"{diagnoser} isolation time", window, start=window[0])
    shown = slice(*np.searchsorted(recording.time, [events.detection, window[1]]))
    started = recording.time >= events.detection
    crossed = (np.abs(residual) > threshold) & started[:, np.newaxis]
    cells = []
    for rotor in range(1, residual.shape[1] // len(labels) + 1):
        of_rotor = slice((rotor - 1) * len(labels), rotor * len(labels))
        excluded = first_true(np.any(crossed[:, of_rotor], axis=1))
        row = []
        for k, label in zip(range(of_rotor.start, of_rotor.stop), labels, strict=True):
            bound = columns.add(clock, f"{diagnoser}.isolation_threshold[{k + 1}]", _from(started, threshold[:, k]))
            column = columns.add(clock, f"{diagnoser}.isolation_residual[{k + 1}]", _from(started, residual[:, k]))
            traces = band(clock, f"-{bound}", bound, "± threshold", "@red", **THRESHOLD)
            traces.append(line(clock, column, "isolation residual", "@blue"))
            if excluded is not None and crossed[excluded, k]:
                traces.append(_crossing(float(recording.time[excluded]), float(residual[excluded, k])))
            row.append(Cell(traces, _reach(residual[shown, k], threshold[shown, k]), label=label))
        verdict = "stays within" if excluded is None else f"leaves at {recording.time[excluded]:.3f} s"
        row[0] = replace(row[0], header=f"<b>Estimator {rotor}</b> {verdict}")
        cells.append(row)
    marks = [Mark(events.detection, "detected", "@orange")]
    data, layout = grid_over_time(cells, window, marks, row_height=125, share_y=False)
    layout["hovermode"] = "closest"
    caption = (
        "One estimator for each rotor, started at the detection. An estimator that leaves the band between its "
        "thresholds cannot explain the flight, and its rotor is excluded; the last one left has failed."
    )
    return Figure(f"{diagnoser}-isolation", "Isolation", caption, data, layout, min_width=820)


def set_membership(recording: Recording, diagnoser: str, columns: Columns, clock: str, events: Events) -> Figure | None:
    """Interval of losses that remains possible for each rotor."""
    lower, upper = (signal(recording, f"{diagnoser}.set_{end}") for end in ("lower", "upper"))
    if lower is None or upper is None or events.detection is None or events.window is None:
        return None
    started = (recording.time >= events.detection)[:, np.newaxis]
    excluded = np.logical_or.accumulate(started & (lower > upper), axis=0)
    drawn = started & ~excluded
    y_range = extent(lower[drawn], upper[drawn], np.zeros(1))
    truth = metrics.true_loss(recording)
    row = []
    for i in range(lower.shape[1]):
        smallest = columns.add(clock, f"{diagnoser}.set_lower[{i + 1}]", _from(drawn[:, i], lower[:, i]))
        largest = columns.add(clock, f"{diagnoser}.set_upper[{i + 1}]", _from(drawn[:, i], upper[:, i]))
        traces = band(clock, smallest, largest, "possible loss", "@blue")
        if truth is not None:
            column = columns.add(clock, f"true loss[{i + 1}]", truth[:, i])
            traces.append(line(clock, column, "truth", "@ink", dash="dash"))
        last = first_true(excluded[:, i])
        verdict = "possible" if last is None else f"excluded at {recording.time[last]:.3f} s"
        row.append(Cell(traces, y_range, f"<b>Rotor {i + 1}</b> {verdict}", y_title="loss of effectiveness"))
    marks = [Mark(events.detection, "detected", "@orange")]
    data, layout = grid_over_time([row], events.window, marks, row_height=190, share_y=True)
    caption = (
        "All measurements since the detection together allow each rotor an interval of losses. "
        "Where it is empty, that rotor alone cannot have failed."
    )
    return Figure(f"{diagnoser}-sets", "Possible losses", caption, data, layout, min_width=720)


def estimation(recording: Recording, diagnoser: str, columns: Columns, clock: str, events: Events) -> Figure | None:
    """Estimated loss of effectiveness with its interval, and the truth (Avram et al., figure 9)."""
    estimate, truth = signal(recording, f"{diagnoser}.loe_estimate"), metrics.true_loss(recording)
    if estimate is None or not (np.any(estimate) or np.any(truth)):
        return None
    traces: list[Trace] = []
    lower, upper = (recording.signals.get(f"{diagnoser}.{port}") for port in ("loe_lower", "loe_upper"))
    if lower is not None and upper is not None and (named := upper > lower).any():
        smallest = columns.add(clock, f"{diagnoser}.loe_lower", _from(named, lower))
        largest = columns.add(clock, f"{diagnoser}.loe_upper", _from(named, upper))
        traces += band(clock, smallest, largest, "interval", "@blue", width=0.8)
    for i in range(estimate.shape[1]):
        column = columns.add(clock, f"{diagnoser}.loe_estimate[{i + 1}]", estimate[:, i])
        traces.append(line(clock, column, f"rotor {i + 1}", ROTOR_COLOURS[i % 4], width=2))
    own = signal(recording, f"{diagnoser}.fie_loe_estimate")
    rotor = _named_rotor(recording, diagnoser)
    if own is not None and rotor is not None and events.detection is not None:
        values = _from(recording.time >= events.detection, own[:, rotor - 1])
        column = columns.add(clock, f"{diagnoser}.fie_loe_estimate[{rotor}]", values)
        traces.append(line(clock, column, f"estimator {rotor} alone", "@red", dash="dot"))
    shown = [estimate, 1.5 * estimate]
    if truth is not None:
        shown.append(1.5 * truth)
        for i in np.flatnonzero(np.any(truth, axis=0)).tolist():
            column = columns.add(clock, f"true loss[{i + 1}]", truth[:, i])
            traces.append(line(clock, column, f"truth of rotor {i + 1}", "@ink", dash="dash"))
    row = Cell(traces, extent(*shown), y_title="loss of effectiveness")
    data, layout = rows_over_time([row], events, row_height=260)
    caption = "Estimated share of thrust that each rotor has lost."
    return Figure(f"{diagnoser}-estimation", "Estimation", caption, data, layout, min_width=640)


def _named_rotor(recording: Recording, diagnoser: str) -> int | None:
    """Rotor that is named at the end, None if there is none."""
    rotor = recording.signals.get(f"{diagnoser}.faulty_rotor")
    return int(rotor[-1]) if rotor is not None and len(rotor) and rotor[-1] >= 1 else None


def _from(started: NDArray[np.bool_], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values where something is to be seen, NaN elsewhere."""
    return np.where(started, values, np.nan)


def _reach(residual: NDArray[np.float64], threshold: NDArray[np.float64]) -> tuple[float, float]:
    """Symmetric range that shows threshold and crossing, also if the residual goes on far beyond."""
    bound = max(extent(threshold)[1], 0.0)
    reach = max(bound, min(extent(np.abs(residual))[1], HEADROOM * bound))
    return -reach, reach


def _crossing(time: float, value: float) -> Trace:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [time],
        "y": [value],
        "name": "crossing",
        "showlegend": False,
        "marker": {"color": "@red", "size": 8, "symbol": "circle-open", "line": {"width": 2}},
        "hovertemplate": "crossing at %{x:.3f} s<extra></extra>",
    }
