"""One self-contained interactive page about a flight: verdict, figures, numbers, settings."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rotordx.orchestrator.metrics import MEANING
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.report import diagnosis_figures, flight_figures
from rotordx.orchestrator.report.axes import Figure
from rotordx.orchestrator.report.columns import Columns
from rotordx.orchestrator.report.events import events
from rotordx.orchestrator.report.verdict import delay_phrase, isolation_phrase, percent, verdict

_UNBROKEN = re.compile(r"(\d) (ms|s|%)(?!\w)")  # a number and its unit stay on one line


def html(recording: Recording, summary: dict[str, Any]) -> str:
    """The page, complete in itself: it works without a network and asks for nothing.

    Args:
        recording: with at least two samples; what is missing in it (truth, reference, residuals) is left out.
        summary: from `metrics.summarise`.
    """
    columns = Columns(recording.time)
    sections = _sections(recording, summary, columns)
    figures = [figure for _, group in sections for figure in group]
    page = {
        "columns": columns.encode(),
        "figures": [{"key": figure.key, "data": figure.data, "layout": figure.layout} for figure in figures],
    }
    parts = {
        "title": escape(str(summary["scenario"] or "recording")),
        "facts": escape(_facts(summary)),
        "verdicts": _verdicts(recording, summary),
        "highlights": _highlights(summary),
        "figures": "\n".join(_section(heading, group) for heading, group in sections),
        "scores": _scores(summary),
        "settings": _settings(recording, summary),
        "data": json.dumps(page, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
    }
    return page_of((files(__package__) / "page.html").read_text(encoding="utf-8"), parts)


def page_of(template: str, parts: dict[str, str]) -> str:
    """A template with its `{{parts}}` in place, and with `head`, `style` and `plotly`, which all pages share."""
    folder = files(__package__)
    parts = parts | {"style": (folder / "page.css").read_text(encoding="utf-8"), "plotly": _plotly()}
    head = _filled((folder / "head.html").read_text(encoding="utf-8").rstrip(), parts)
    return _filled(template, parts | {"head": head})


def _filled(template: str, parts: dict[str, str]) -> str:
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _sections(recording: Recording, summary: dict[str, Any], columns: Columns) -> list[tuple[str, list[Figure]]]:
    """Figures of the page, and the diagnoser they belong to; "" for the flight, and if there is only one."""
    scores = summary["diagnosers"]
    noticed = {
        diagnoser: events(recording, score["detection_time_s"], score["isolation_time_s"])
        for diagnoser, score in scores.items()
    }
    flown = next(iter(noticed.values())) if len(noticed) == 1 else events(recording)
    clock = columns.clock("flight time", flown.window)
    groups: list[tuple[str, list[Figure | None]]] = [
        (
            "",
            [flight_figures.path(recording, columns, flown), flight_figures.tracking(recording, columns, clock, flown)],
        )
    ]
    for diagnoser, seen in noticed.items():
        its_clock = columns.clock(f"{diagnoser} time", seen.window)
        figures = [
            diagnosis_figures.detection(recording, diagnoser, columns, its_clock, seen),
            diagnosis_figures.isolation(recording, diagnoser, columns, seen),
            diagnosis_figures.estimation(recording, diagnoser, columns, its_clock, seen),
            diagnosis_figures.set_membership(recording, diagnoser, columns, its_clock, seen),
        ]
        groups.append((diagnoser if len(noticed) > 1 else "", figures))
    groups.append(("", [flight_figures.rotor_speeds(recording, columns, clock, flown)]))
    return [(heading, [figure for figure in group if figure is not None]) for heading, group in groups]


def _facts(summary: dict[str, Any]) -> str:
    facts = [summary["vehicle"], None if summary["seed"] is None else f"seed {summary['seed']}"]
    facts += [f"{summary['duration_s']:.4g} s", f"{summary['steps']:,} steps"]
    if summary["real_time_factor"]:
        facts.append(f"{summary['real_time_factor']:,.0f} × real time")
    return " · ".join(str(fact) for fact in facts if fact)


def _verdicts(recording: Recording, summary: dict[str, Any]) -> str:
    rows = []
    for diagnoser in summary["diagnosers"]:
        found = verdict(recording, summary, diagnoser)
        who = ", ".join(filter(None, (diagnoser, isolation_phrase(recording, diagnoser))))
        sentence = _UNBROKEN.sub(r"\1&nbsp;\2", escape(found.sentence))
        rows.append(f'<li class="{found.state}"><span class="who">{escape(who)}</span> <span>{sentence}</span></li>')
    return "\n".join(rows) or '<li class="open"><span>No diagnoser was run.</span></li>'


def _highlights(summary: dict[str, Any]) -> str:
    """The few numbers one asks for first, of the only diagnoser; several are compared in the table."""
    if len(summary["diagnosers"]) != 1:
        return ""
    score = next(iter(summary["diagnosers"].values()))
    rotor = score["faulty_rotor"]
    loss = score["loe_estimate"][rotor - 1] if rotor > 0 else None
    peak = score["peak_residual_ratio_before_fault"]
    cards: list[tuple[str, Any, Callable[[Any], str]]] = [
        ("detected after", score["detection_delay_s"], delay_phrase),
        ("isolated after", score["isolation_delay_s"], delay_phrase),
        ("estimated loss", loss, percent),
        ("final estimation error", score["loe_final_error"], "{:+.4f}".format),
        ("healthy peak of residual / threshold", peak, "{:.2f}".format),
        ("computing time per step", score["step_time_ns"], "{:,.0f} ns".format),
    ]
    return "\n".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(show(value))}</dd></div>"
        for name, value, show in cards
        if value is not None
    )


def _section(diagnoser: str, group: list[Figure]) -> str:
    heading = f'<h2 class="diagnoser">{escape(diagnoser)}</h2>' if diagnoser and group else ""
    return f"<section>{heading}{''.join(map(_figure, group))}</section>" if group else ""


def _figure(figure: Figure) -> str:
    title, caption = escape(figure.title), escape(figure.caption)
    size = f"height:{figure.layout['height']}px;min-width:{figure.min_width}px"
    plot = f'<div class="plot" role="img" aria-label="{title}: {caption}" style="{size}"></div>'
    return f"""<figure id="{escape(figure.key)}">
<h2>{title}</h2><p>{caption}</p><div class="scroll">{plot}</div>
</figure>
"""


def _scores(summary: dict[str, Any]) -> str:
    """All figures of all diagnosers side by side."""
    scores = summary["diagnosers"]
    if not scores:
        return ""
    head = "".join(f'<th scope="col">{escape(diagnoser)}</th>' for diagnoser in scores)
    body = "".join(
        f'<tr><th scope="row"><code>{name}</code></th>'
        + "".join(f"<td>{escape(_plain(score[name]))}</td>" for score in scores.values())
        + f"<td>{escape(meaning)}</td></tr>"
        for name, meaning in MEANING.items()
    )
    return f'<table><thead><tr><th scope="col">figure</th>{head}<th scope="col">meaning</th></tr></thead>{body}</table>'


def _settings(recording: Recording, summary: dict[str, Any]) -> str:
    flight = {name: value for name, value in summary.items() if name != "diagnosers"}
    blocks = [
        ("Flight", json.dumps(flight, indent=2)),
        ("Scenario", json.dumps(recording.scenario, indent=2, default=str)),
    ]
    for component, messages in (recording.measurements.get("messages") or {}).items():
        blocks.append((f"Messages of {component}", "\n".join(map(str, messages))))
    return "\n".join(
        f"<details><summary>{escape(title)}</summary><pre>{escape(text)}</pre></details>" for title, text in blocks
    )


def _plain(value: Any) -> str:
    """A value of the summary as one reads it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(_plain(element) for element in value)
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _plotly() -> str:
    """plotly.js as it comes with the Python package, found without importing that."""
    spec = find_spec("plotly")
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError("the Python package plotly is not installed")
    return (Path(spec.submodule_search_locations[0]) / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
