"""Plotly traces and axes that the figures of a report are made of.

A specification is readable on its own: where Plotly expects numbers it names a column such as "$fdie.residual[1]"
("-$..." for its negative), where it expects a colour it names one of the page's ("@blue"). The page fills in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rotordx.orchestrator.report.events import Events, Mark, Period

Trace = dict[str, Any]
Layout = dict[str, Any]
TOP, BOTTOM, LEFT, RIGHT = 62, 44, 64, 12  #: px around the axes
WIDTHS = ((0.0, 0.55), (0.6, 1.0))  #: of the whole period and of the window beside it


@dataclass(frozen=True)
class Figure:
    """One figure of the page."""

    key: str
    title: str
    caption: str  #: what to look for
    data: list[Trace]
    layout: Layout
    min_width: int = 0  #: px below which the page scrolls the figure instead of squeezing it


@dataclass(frozen=True)
class Cell:
    """One pair of axes: its traces (without axes), what stands above it (left and right) and at its y axis."""

    traces: list[Trace]
    y_range: tuple[float, float]
    header: str = ""
    label: str = ""
    y_title: str = ""


def line(x: Any, y: Any, name: str, colour: str, **style: Any) -> Trace:
    """A line; `style` goes to Plotly's line (width, dash, shape)."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "legendgroup": name,
        "line": {"color": colour, "width": 1.4, **style},
        "hovertemplate": "%{y:.4g}",
    }


def band(x: Any, lower: Any, upper: Any, name: str, colour: str, **style: Any) -> list[Trace]:
    """The area between two lines, with one entry in the legend."""
    return [
        line(x, lower, name, colour, **style) | {"showlegend": False},
        line(x, upper, name, colour, **style) | {"fill": "tonexty", "fillcolor": f"{colour}-soft"},
    ]


def rows_over_time(rows: Sequence[Cell], events: Events, row_height: int) -> tuple[list[Trace], Layout]:
    """Axes above each other, time to the right: the whole period and, beside it in the same scale, the window."""
    views = [events.period] if events.window is None else [events.period, events.window]
    domains = [(0.0, 1.0)] if events.window is None else WIDTHS
    marks = events.marks()
    layout, y_domains = _layout(len(rows), row_height, gap=14)
    data: list[Trace] = []
    for r, row in enumerate(rows):
        for v, view in enumerate(views):
            k, bottom = r * len(views) + v, r == len(rows) - 1
            layout[f"xaxis{_number(k)}"] = _time_axis(k, v, domains[v], view, bottom)
            layout[f"yaxis{_number(k)}"] = _value_axis(k, k - v, y_domains[r], row)
            data += _on_axes(row.traces, k)
    for v in range(len(views)):
        layout["shapes"] += [_vertical_line(mark, v, "paper") for mark in marks]
    layout["annotations"] += _mark_labels(marks, len(views) - 1, views[-1])
    return data, layout


def grid_over_time(
    cells: Sequence[Sequence[Cell]], window: Period, marks: Sequence[Mark], row_height: int, share_y: bool
) -> tuple[list[Trace], Layout]:
    """Small multiples over one period."""
    layout, y_domains = _layout(len(cells), row_height, gap=30)
    data: list[Trace] = []
    count = len(cells[0])
    spacing = 0.02 if share_y else 0.05
    width = (1 - spacing * (count - 1)) / count
    for r, row in enumerate(cells):
        for c, cell in enumerate(row):
            k, left = r * count + c, c * (width + spacing)
            layout[f"xaxis{_number(k)}"] = _time_axis(k, 0, (left, left + width), window, r == len(cells) - 1)
            layout[f"yaxis{_number(k)}"] = _value_axis(k, 0 if share_y else k, y_domains[r], cell)
            data += _on_axes(cell.traces, k)
            layout["annotations"] += [_above(cell.header, k, "left"), _above(cell.label, k, "right")]
            layout["shapes"] += [_vertical_line(mark, k, f"y{_number(k)} domain") for mark in marks]
    return data, layout


def base_layout(height: int) -> Layout:
    """What all figures share; the page adds fonts and the colours of the axes."""
    return {
        "height": height,
        "margin": {"t": TOP, "b": BOTTOM, "l": LEFT, "r": RIGHT},
        "hovermode": "x unified",
        "legend": {"orientation": "h", "x": 0, "xanchor": "left", "yref": "container", "y": 1, "yanchor": "top"},
        "shapes": [],
        "annotations": [],
    }


def _layout(rows: int, row_height: int, gap: int) -> tuple[Layout, list[tuple[float, float]]]:
    """Layout and the y domains of `rows` axes of `row_height` px, `gap` px apart, from the top."""
    height = rows * row_height + (rows - 1) * gap
    tops = [1 - r * (row_height + gap) / height for r in range(rows)]
    return base_layout(TOP + BOTTOM + height), [(max(top - row_height / height, 0.0), top) for top in tops]


def _time_axis(k: int, leader: int, domain: tuple[float, float], view: Period, labelled: bool) -> Layout:
    """x axis k, which zooms with the axis `leader`."""
    return {
        "domain": domain,
        "anchor": f"y{_number(k)}",
        "range": view,
        "showticklabels": labelled,
        "title": {"text": "time (s)" if labelled else "", "standoff": 6},
    } | ({"matches": f"x{_number(leader)}"} if k != leader else {})


def _value_axis(k: int, leader: int, domain: tuple[float, float], cell: Cell) -> Layout:
    """y axis k, which zooms with the axis `leader` and has its ticks there."""
    axis = {"domain": domain, "anchor": f"x{_number(k)}", "range": cell.y_range, "nticks": 5}
    if k != leader:
        return axis | {"matches": f"y{_number(leader)}", "showticklabels": False}
    return axis | {"title": {"text": cell.y_title, "standoff": 4}}


def _on_axes(traces: Sequence[Trace], k: int) -> list[Trace]:
    """Traces on the k-th pair of axes; the first pair speaks for all in the legend."""
    return [
        trace | {"xaxis": f"x{_number(k)}", "yaxis": f"y{_number(k)}"} | ({"showlegend": False} if k else {})
        for trace in traces
    ]


def _vertical_line(mark: Mark, k: int, over: str) -> Layout:
    """Line on the k-th x axis, over the height of one pair of axes or of them all."""
    return {
        "type": "line",
        "xref": f"x{_number(k)}",
        "yref": over,
        "x0": mark.time,
        "x1": mark.time,
        "y0": 0,
        "y1": 1,
        "line": {"color": mark.colour, "width": 1.3, "dash": "dot"},
    }


def _mark_labels(marks: Sequence[Mark], k: int, view: Period) -> list[Layout]:
    """Labels above the axes. Events follow each other closely: the first is written to the left, later ones lower."""
    visible = [mark for mark in marks if view[0] <= mark.time <= view[1]]
    labels = []
    for i, mark in enumerate(visible):
        share = (mark.time - view[0]) / (view[1] - view[0])
        side = "right" if share > 0.6 or (i == 0 and len(visible) > 1 and share > 0.15) else "left"
        labels.append(
            _above(f"{mark.label} {mark.time:.3f} s", k, side)
            | {"xref": f"x{_number(k)}", "x": mark.time, "yref": "paper"}
            | {"xshift": -3 if side == "right" else 3, "yshift": 2 + 15 * max(len(visible) - 1 - max(i, 1), 0)}
            | {"font": {"size": 12, "color": mark.colour}}
        )
    return labels


def _above(text: str, k: int, side: str) -> Layout:
    """Text above the k-th pair of axes, at its left or right end."""
    return {
        "text": text,
        "xref": f"x{_number(k)} domain",
        "yref": f"y{_number(k)} domain",
        "x": 0 if side == "left" else 1,
        "y": 1,
        "yshift": 2,
        "xanchor": side,
        "yanchor": "bottom",
        "showarrow": False,
        "font": {"size": 12, "color": "@ink" if side == "left" else "@muted"},
    }


def _number(index: int) -> str:
    """Plotly's suffix of the axis with this index: "", "2", "3", ..."""
    return "" if index == 0 else str(index + 1)
