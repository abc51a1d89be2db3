"""A design explained: what was asked, what was solved, and what another speed would give."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor, log10
from types import ModuleType
from typing import Any

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains.certificate import CertifiedDesign
from rotordx.gains.options import DesignError, described

#: Multiples of the asked speed at which the trade-off is drawn.
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True)
class TradeOff:
    """Response and noise at one speed, the worst of the estimates."""

    speed: float
    settling_time: float  #: s, until the estimates are within 5 %
    noise_std: float  #: of the estimates


def explanation(module: ModuleType, vehicle: Vehicle, options: Any, design: CertifiedDesign) -> Iterator[str]:
    """Lines that say what was asked and what was solved."""
    yield inspect.getdoc(module) or ""
    yield ""
    yield "What was asked (change it with --set NAME=VALUE):"
    for name, value, unit, meaning in described(options):
        quantity = f"{value} {unit}" if unit not in ("", "1") else f"{value}"
        yield f"  {name} = {quantity}: {meaning}"
    subjects = module.subjects(vehicle, options, design.parameters)
    for certificate in design.certificates:
        about = subjects[certificate.name]
        yield ""
        yield f"{certificate.name}: {certificate.theory.statement}"
        yield "Proved positive definite, in floating point and exactly:"
        for name, matrix in about.theory.inequalities(about.model, about.gain, certificate.proof).items():
            yield f"  {name}: {len(matrix)} x {len(matrix)}"
        for formula in certificate.theory.formulas:
            text = (inspect.getdoc(formula) or "").partition("\n\nArgs:")[0]
            yield f"  {formula.__name__}: " + text.replace("\n\n", "\n").replace("\n", "\n    ")


def trade_off(module: ModuleType, vehicle: Vehicle, options: Any, design: CertifiedDesign) -> list[TradeOff]:
    """The compromise between response and noise, at the speeds at which there is a design."""
    points = []
    for factor in SPEEDS:
        other = dataclasses.replace(options, speed=options.speed * factor)
        try:
            made = design if factor == 1 else module.design(vehicle, other)
        except DesignError:
            continue
        figures = next(c.figures for c in made.certificates if "settling_time" in c.figures)
        if None not in figures["settling_time"]:
            points.append(TradeOff(other.speed, max(figures["settling_time"]), max(figures["noise_std"])))
    return points


def figure(points: Sequence[TradeOff], title: str) -> str:
    """The trade-off as an SVG document: noise over settling time, logarithmic, each point with its speed."""
    width, height, margin = 640, 420, 70
    x_axis = _axis([p.settling_time for p in points], margin, width - margin / 2)
    y_axis = _axis([p.noise_std for p in points], height - margin, margin / 2 + 20)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">',
        "<style>text { font-size: 13px }</style>",
        f'<rect width="{width}" height="{height}" fill="white"/>',
        f'<text x="{width / 2}" y="24" text-anchor="middle" style="font-size: 15px">{title}</text>',
        f'<text x="{width / 2}" y="{height - 18}" text-anchor="middle">settling time to 5 %, s</text>',
        f'<text transform="translate(18 {height / 2}) rotate(-90)" text-anchor="middle">'
        "standard deviation of the estimates</text>",
    ]
    for value, x in x_axis.ticks:
        lines.append(f'<line x1="{x:.1f}" y1="{margin / 2 + 20}" x2="{x:.1f}" y2="{height - margin}" stroke="#ddd"/>')
        lines.append(f'<text x="{x:.1f}" y="{height - margin + 20}" text-anchor="middle">{value:g}</text>')
    for value, y in y_axis.ticks:
        lines.append(f'<line x1="{margin}" y1="{y:.1f}" x2="{width - margin / 2}" y2="{y:.1f}" stroke="#ddd"/>')
        lines.append(f'<text x="{margin - 8}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    places = [(x_axis.place(p.settling_time), y_axis.place(p.noise_std)) for p in points]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    lines.append(f'<polyline points="{path}" fill="none" stroke="#1f77b4" stroke-width="2"/>')
    for point, (x, y) in zip(points, places, strict=True):
        lines.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="#1f77b4"/>')
        lines.append(f'<text x="{x + 8:.1f}" y="{y - 8:.1f}">speed {point.speed:g}</text>')
    return "\n".join([*lines, "</svg>", ""])


@dataclass(frozen=True)
class _Axis:
    """A logarithmic axis: pixel = start + slope log10(value)."""

    start: float
    slope: float
    ticks: list[tuple[float, float]]

    def place(self, value: float) -> float:
        return self.start + self.slope * log10(value)


def _axis(values: Sequence[float], first: float, last: float) -> _Axis:
    """Axis from a fifth below the smallest to a fifth above the largest value; ticks at 1, 2, 3, 5, 7 of a decade."""
    low, high = log10(min(values) / 1.2), log10(max(values) * 1.2)
    slope = (last - first) / (high - low)
    start = first - slope * low
    candidates = [digit * 10.0**decade for decade in range(floor(low), floor(high) + 1) for digit in (1, 2, 3, 5, 7)]
    ticks = [(v, start + slope * log10(v)) for v in candidates if low <= log10(v) <= high]
    return _Axis(start, slope, ticks)
