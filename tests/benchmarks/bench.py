"""Measures the promises on speed in one run: `make bench`.

Times are CPU times of this process, the best of several rounds; those of whole commands are wall times. A promise that
is not met is marked, and makes the exit code 1.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rotordx.orchestrator import metrics, report, results
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.stepper import Stepper
from rotordx.orchestrator.system import System
from tests.benchmarks.fmpy_master import FmpyMaster

SCENARIO = "avram_circle"
STEPS = 10_000
WARM_UP = 500
ROUNDS = 7

#: a run that says when its first step begins
FIRST_STEP = """
import functools, sys
from rotordx.orchestrator import flight
from rotordx.orchestrator.cli import main

def first_step(time, signals):
    print("first step", flush=True)
    sys.exit()

flight.fly = functools.partial(flight.fly, callback=first_step)
main(["run"])
"""


class Table:
    """Prints figures with their promises as they come, and remembers whether all were kept."""

    def __init__(self) -> None:
        self.kept = True

    def heading(self, text: str) -> None:
        print(f"\n{text}")

    def row(self, name: str, value: float, unit: str, *, at_most: float | None = None, at_least: float | None = None):
        promise = ""
        if at_most is not None or at_least is not None:
            kept = value <= at_most if at_most is not None else value >= (at_least or 0)
            bound = f"at most {at_most:g}" if at_most is not None else f"at least {at_least:g}"
            promise = f"{bound} {unit}".strip() + ("" if kept else "   MISSED")
            self.kept &= kept
        print(f"  {name:44} {value:10.3f} {unit:6} {promise}".rstrip())


def best_cpu_time(
    action: Callable[[], object], prepare: Callable[[], object] = lambda: None, rounds: int = ROUNDS
) -> float:
    """Smallest CPU time of an action in seconds; `prepare` comes before each round and does not count."""
    times = []
    for _ in range(rounds):
        prepare()
        begin = time.process_time()
        action()
        times.append(time.process_time() - begin)
    return min(times)


def best_wall_time(arguments: list[str], until_line: bool = False, rounds: int = ROUNDS) -> float:
    """Smallest time in seconds from starting Python to its end, or to the first line that it prints."""
    times = []
    for _ in range(rounds):
        begin = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert process.stdout is not None
        if until_line:
            process.stdout.readline()
        else:
            process.stdout.read()
        times.append(time.perf_counter() - begin)
        process.communicate()
    return min(times)


def per_step(table: Table, fmi: int) -> None:
    """The stepping loop on the whole system, every component in one FMI version."""
    names = ("reference", "controller", "esc", "plant", "sensors", "fdie")
    scenario = load_scenario(SCENARIO, components={name: {"fmi": fmi} for name in names})
    with System(scenario) as system:
        alone = Stepper(system.stepper.components, None, scenario.step_size_s)
        log = np.empty((STEPS, system.wiring.width))

        def start() -> None:
            system.initialise(scenario)
            system.stepper.advance(0, WARM_UP)

        bare = best_cpu_time(lambda: alone.advance(WARM_UP, STEPS), start) / STEPS
        native = best_cpu_time(lambda: system.stepper.advance(WARM_UP, STEPS), start) / STEPS
        logged = best_cpu_time(lambda: system.stepper.advance(WARM_UP, STEPS, log=log), start) / STEPS
        fewer = STEPS // 20
        masters: list[FmpyMaster] = []
        python = (
            best_cpu_time(
                lambda: masters[-1].advance(WARM_UP, fewer), lambda: (start(), masters.append(FmpyMaster(system)))
            )
            / fewer
        )
    table.heading(f"One step of {SCENARIO}, {len(names)} FMI {fmi} FMUs, {log.shape[1]} outputs")
    table.row("bare doStep of all FMUs", 1e6 * bare, "us")
    table.row("native stepper", 1e6 * native, "us")
    table.row("native stepper with log", 1e6 * logged, "us")
    table.row("FMPy's own methods", 1e6 * python, "us")
    table.row("native stepper / bare doStep", native / bare, "", at_most=1.3)
    table.row("FMPy's own methods / native stepper", python / native, "", at_least=60)


def whole_flight(table: Table) -> None:
    """A flight of 60 s and what is made of it."""
    scenario = load_scenario(SCENARIO)
    with System(scenario) as system:
        stepping = best_cpu_time(lambda: system.stepper.advance(0, scenario.steps), lambda: system.initialise(scenario))
        flight = best_cpu_time(lambda: fly(scenario, system))
        recording = fly(scenario, system)
    summary = metrics.summarise(recording)
    columns = sum(values[0].size for values in recording.signals.values())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "timeseries.parquet"
        writing = best_cpu_time(lambda: results.write_timeseries(recording, file), rounds=3)
        size = file.stat().st_size
    page = report.html(recording, summary)
    reporting = best_cpu_time(lambda: report.html(recording, summary), rounds=3)
    table.heading(f"{SCENARIO}: {scenario.duration_s:g} s, {scenario.steps} steps")
    table.row("stepping", stepping, "s", at_most=0.1)
    table.row("flight: reset, initialise, step, log", flight, "s")
    table.row("flights per core and hour", 3600 / flight, "")
    table.row(f"writing the log of {columns} signals", writing, "s")
    table.row("the same for 120 signals", writing * 120 / columns, "s", at_most=0.15)
    table.row("size of the log", size / 2**20, "MiB")
    table.row("making the report", reporting, "s", at_most=0.5)
    table.row("size of the report", len(page.encode()) / 1e6, "MB", at_most=6)


def start_up(table: Table) -> None:
    """From a command to its effect."""
    table.heading("Start-up (wall time)")
    command = ["-c", "from rotordx.orchestrator.cli import main; main()"]
    table.row("python without anything", best_wall_time(["-c", ""]), "s")
    table.row("rotordx --help", best_wall_time([*command, "--help"]), "s", at_most=0.2)
    table.row("rotordx run, until its first step", best_wall_time(["-c", FIRST_STEP], until_line=True), "s", at_most=1)


def main() -> int:
    """Print all figures."""
    table = Table()
    for fmi in (2, 3):
        per_step(table, fmi)
    whole_flight(table)
    start_up(table)
    return 0 if table.kept else 1


if __name__ == "__main__":
    sys.exit(main())
