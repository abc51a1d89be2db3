"""What the campaigns share: where and how figures are written, and the processes that fly."""

import json
import multiprocessing
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parent / "results"
ROTORS = (1, 2, 3, 4)


def processes(workers: int) -> ProcessPoolExecutor:
    """Processes that start from nothing, as FMUs are loaded in them."""
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def or_nan(value: float | None) -> float:
    """A figure of a summary; NaN where it never came to that."""
    return float("nan") if value is None else float(value)


def share(delays: Sequence[float]) -> str:
    """Share of the flights in which it came to that."""
    return f"{100 * np.mean(np.isfinite(delays)):.0f} %"


def milliseconds(delays: Sequence[float]) -> str:
    """Median and largest of delays in s; NaN if it did not come to that in one flight."""
    return f"{1000 * np.median(delays):.0f} ({1000 * np.max(delays):.0f})"


def share_and_milliseconds(delays: Sequence[float]) -> str:
    """Share of the flights in which it came to that, and the delays in those."""
    reached = [delay for delay in delays if np.isfinite(delay)]
    return f"{share(delays)}, {milliseconds(reached)}" if reached else share(delays)


def markdown_table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Lines of a table."""
    body = ["| " + " | ".join(map(str, cells)) + " |" for cells in (columns, *rows)]
    return [body[0], "|" + "---|" * len(columns), *body[1:]]


def write_results(name: str, lines: Sequence[str], facts: Any) -> None:
    """Write results/<name>.md and what it rests on, results/<name>.json, with null for NaN; print the former."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (RESULTS / f"{name}.json").write_text(json.dumps(facts).replace("NaN", "null") + "\n", encoding="utf-8")
    print("\n".join(lines))
