"""Papers' experiments flown again: what each paper claims beside what comes out here.

A folder of this package is a paper: it defines `CITATION` and `reproduce(seeds, progress)`, and is found by its name.
The modules beside the folders serve all papers.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rotordx.orchestrator.errors import UserError

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from rotordx.orchestrator.recording import Recording
    from rotordx.orchestrator.scenario import Scenario

#: of a curve in a figure
POINTS = 2000

#: tells how much of the work is done, 0 to 1
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Claim:
    """One thing that the paper says."""

    quantity: str  #: what it is about, with its unit
    paper: str  #: as the paper says it
    ours: str  #: as it came out here
    holds: bool | None  #: None: cannot be decided, as the paper only shows a plot
    remark: str = ""  #: why it does not hold, what was assumed


@dataclass(frozen=True)
class Figure:
    """One figure; its caption describes what the paper's plot shows and where ours differs."""

    title: str
    caption: str
    figure: go.Figure


@dataclass(frozen=True)
class Reproduction:
    """What became of a paper."""

    citation: str
    verdict: str  #: the honest conclusion in one or two sentences
    claims: list[Claim]
    figures: list[Figure]


def papers() -> list[str]:
    """Names of the papers that can be reproduced."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if module.ispkg)


def reproduce(paper: str, seeds: int, progress: Progress = lambda _: None) -> Reproduction:
    """Repeat the experiments of a paper.

    Args:
        paper: one of `papers()`.
        seeds: number of noisy repetitions behind each statistic.
        progress: called with the part that is done.

    Raises:
        UserError: if there is no such paper.
    """
    if paper not in papers():
        raise UserError(f"there is no paper {paper!r} to reproduce; choose among {', '.join(papers())}")
    result: Reproduction = import_module(f"{__name__}.{paper}").reproduce(seeds, progress)
    return result


def curves(
    title: str, caption: str, x: str, y: str, lines: Mapping[str, tuple[Any, Any]], dashed: tuple[str, ...] = ()
) -> Figure:
    """Figure of curves.

    Args:
        x, y: what the axes show, with units.
        lines: name -> (abscissas, ordinates); long ones are thinned out without losing a peak.
        dashed: names of the lines to draw dashed, such as the truth.
    """
    import numpy as np
    import plotly.graph_objects as go

    from rotordx.orchestrator.report.decimation import bucket_starts, bucket_times, envelope

    figure = go.Figure()
    for name, (abscissas, ordinates) in lines.items():
        time, values = np.asarray(abscissas, dtype=float), np.asarray(ordinates, dtype=float)
        if len(time) > POINTS:
            starts = bucket_starts(len(time), POINTS)
            time, values = bucket_times(time, starts), envelope(values, starts)
        dash = "dash" if name in dashed else "solid"
        figure.add_scatter(x=time, y=values, name=name, mode="lines", line={"dash": dash, "width": 1.6})
    figure.update_layout(xaxis_title=x, yaxis_title=y)
    return Figure(title, caption, figure)


def flights(scenario: Scenario, seeds: int, progress: Progress = lambda _: None) -> Iterator[Recording]:
    """Fly a scenario with `seeds` seeds, from its own one on; the FMUs are loaded once."""
    from rotordx.orchestrator.flight import fly
    from rotordx.orchestrator.system import System

    with System(scenario) as system:
        for i in range(seeds):
            yield fly(scenario.changed(seed=scenario.seed + i), system)
            progress((i + 1) / seeds)
