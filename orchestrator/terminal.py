"""What a command shows while it works and when it is done: progress on stderr, verdicts on stdout.

Rich is imported where it is used, for a flight should not wait for it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.report.verdict import delay_phrase, verdict
from rotordx.orchestrator.results import REPORT

COLOURS = {"good": "green", "fair": "yellow", "bad": "red", "open": "default"}


@contextmanager
def progress(title: str, total: float, unit: str = " s") -> Iterator[Callable[[float], None]]:
    """A function that shows how much of a flight's time (s), or of other work, is done.

    On a terminal it is a bar, which disappears at the end; otherwise one line at the start has to do.
    """
    if not sys.stderr.isatty():
        click.echo(f"{title}: {total:g}{unit}" if unit else f"{title} ...", err=True)
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    done = TextColumn(f"{{task.completed:.1f}}{unit}" if unit else "{task.percentage:.0f} %")
    columns = (TextColumn("{task.description}"), BarColumn(), done, TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda time: bar.update(task, completed=time)


def show_result(recording: Recording, summary: dict[str, Any], folder: Path) -> None:
    """Show the verdict on each diagnoser, their figures, what the FMUs logged, and where the report is."""
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("diagnoser", "detected", "isolated", "rotor", "loss", "peak residual", "step"):
        table.add_column(heading)
    for diagnoser, score in summary["diagnosers"].items():
        judged = verdict(recording, summary, diagnoser)
        console.print(f"[{COLOURS[judged.state]}]{judged.sentence}[/]", soft_wrap=True)
        table.add_row(diagnoser, *_cells(score))
    if summary["diagnosers"]:
        console.print()
        console.print(table)
    for component, messages in recording.measurements.get("messages", {}).items():
        for message in messages:
            console.print(f"{component}: {message}", soft_wrap=True, markup=False)
    console.print(f"\nreport: {folder / REPORT}", soft_wrap=True, markup=False)


def _cells(score: dict[str, Any]) -> list[str]:
    """Delays after the onset, the rotor named, its estimated loss, residual over threshold before the fault."""
    rotor = score["faulty_rotor"]
    detected, isolated = (score[f"{event}_delay_s"] for event in ("detection", "isolation"))
    estimate = score["loe_estimate"][rotor - 1] if rotor > 0 else None
    peak, step_time = score["peak_residual_ratio_before_fault"], score["step_time_ns"]
    return [
        "-" if detected is None else f"+{delay_phrase(detected)}",
        "-" if isolated is None else f"+{delay_phrase(isolated)}",
        {0: "-", -1: "none of them"}.get(rotor, str(rotor)),
        "-" if estimate is None else f"{estimate:.3f}",
        "-" if peak is None else f"{peak:.2f}",
        "-" if step_time is None else f"{step_time:.0f} ns",
    ]
