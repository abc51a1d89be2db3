"""Measures every diagnoser's exported C and writes the figures where exports and their documentation find them.

`make c-table` runs it, `python -m tests.c_export.table ID...` for some of them: code size, stack and instructions on an
emulated Cortex-M7, and single against double precision on whole flights. It writes `figures.json` and the table in the
README of `orchestrator/export`.
"""

from __future__ import annotations

import json
import sys
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.diagnosers.codegen import diagnoser_function
from rotordx.orchestrator.export import c_source
from tests.c_export.toolchain import (
    CORTEX_M7,
    EMULATOR,
    PRECISIONS,
    Export,
    cortex_m7_program,
    export,
    flown,
    host_program,
    loss_difference,
    measured_steps,
    played,
    run,
    same_verdict,
)

FOLDER = Path(str(files("rotordx.orchestrator.export")))
README, FIGURES = FOLDER / "README.md", FOLDER / "figures.json"
OPENING, CLOSING = "<!-- figures -->\n", "<!-- /figures -->\n"
ONSET, LOSS = 24.0, 0.2
#: whole flights of 60 s: none, and a loss in each rotor
FAULTS: list[list[dict[str, float]]] = [
    [],
    *([{"rotor": rotor, "onset_s": ONSET, "loss_of_effectiveness": LOSS}] for rotor in (1, 2, 3, 4)),
]


def measure(diagnoser: str, folder: Path) -> dict[str, Any]:
    """Everything about one diagnoser; one flight goes through the emulator, all go through single precision here."""
    exported = export(diagnoser, folder / diagnoser)
    flights = [flown(diagnoser, faults=faults, seed=seed) for seed, faults in enumerate(FAULTS, start=1)]
    targets = {precision: _on_cortex_m7(exported, precision, flights[1], folder) for precision in PRECISIONS}
    program = host_program(exported, "single", folder)
    verdicts, losses = [], []
    for inputs, answers in flights:
        outputs = played([program], inputs, folder)
        verdicts.append(same_verdict(outputs, answers, exported.subject.step_size))
        losses.append(loss_difference(outputs, answers))
    return {
        "source_sha256": c_source.source_hash(diagnoser),
        "casadi_instructions": diagnoser_function(diagnoser).n_instructions(),
        "targets": targets,
        "single_precision": {
            "flights": len(flights),
            "same_verdicts": sum(verdicts),
            "largest_loe_difference": max(losses),
        },
    }


def table(figures: dict[str, Any]) -> str:
    """The figures in Markdown."""
    lines = [
        "| diagnoser | CasADi operations | code B | stack B | instructions | difference to the FMU | "
        "same verdict in single | largest difference of the loss |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, f in figures.items():
        double, single = (f["targets"][precision] for precision in PRECISIONS)
        pairs = [f"{double[key]} / {single[key]}" for key in ("code_bytes", "stack_bytes", "instructions")]
        cells = [f"`{name}`", f["casadi_instructions"], *pairs, f"{double['difference']:.1g}"]
        check = f["single_precision"]
        cells += [f"{check['same_verdicts']} of {check['flights']}", f"{check['largest_loe_difference']:.1e}"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def _on_cortex_m7(exported: Export, precision: str, flight: tuple[Any, Any], folder: Path) -> dict[str, Any]:
    inputs, answers = flight
    sizes = cortex_m7_program(exported, precision, folder)
    outputs = played(EMULATOR, inputs, folder)
    known = ~np.isnan(answers)
    difference = np.abs(outputs - answers)[known] / (1 + np.abs(answers[known]))
    return {**sizes, **measured_steps(folder), "difference": float(difference.max())}


def main() -> None:
    """Measure all, or those that are named, then write."""
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        for diagnoser in sys.argv[1:] or diagnoser_ids():
            figures[diagnoser] = measure(diagnoser, Path(folder))
            print(table({diagnoser: figures[diagnoser]}).splitlines()[-1], flush=True)
    figures = {name: figures[name] for name in diagnoser_ids() if name in figures}
    FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    before, _, rest = README.read_text(encoding="utf-8").partition(OPENING)
    _, _, after = rest.partition(CLOSING)
    compiler = run([CORTEX_M7[0], "--version"]).splitlines()[0]
    README.write_text(f"{before}{OPENING}\n{table(figures)}\n\n{compiler}\n\n{CLOSING}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
