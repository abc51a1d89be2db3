"""Measures the promises on speed in one run: `make bench`.

Times are CPU times of this process, the best of several rounds; those of whole commands are wall times. A promise that
is not met is marked.
"""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.diagnosers.codegen import INSTRUCTION_BUDGET, diagnoser_function
from rotordx.orchestrator import metrics, report, results
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.stepper import Stepper
from rotordx.orchestrator.system import System
from tests.benchmarks.fmpy_master import FmpyMaster

SCENARIO = "avram_circle"
STEPS = 10_000
WARM_UP = 500
SLOWER = 20  #: FMPy's methods get this fraction of the steps
ROUNDS = 7

#: a run that ends where its first step would begin
FIRST_STEP = """
import functools, os
from rotordx.orchestrator import flight
from rotordx.orchestrator.cli import main

def first_step(time, signals):
    os._exit(0)

flight.fly = functools.partial(flight.fly, callback=first_step)
main(["run"])
"""


class Table:
    """Prints figures with their promises as they come."""

    def heading(self, text: str) -> None:
        print(f"\n{text}")

    def row(self, name: str, value: float, unit: str, *, at_most: float | None = None, at_least: float | None = None):
        promise = ""
        if at_most is not None or at_least is not None:
            kept = value <= at_most if at_most is not None else value >= (at_least or 0)
            bound = f"at most {at_most:g}" if at_most is not None else f"at least {at_least:g}"
            promise = f"{bound} {unit}".strip() + ("" if kept else "   MISSED")
        print(f"  {name:44} {value:10.3f} {unit:6} {promise}".rstrip())


def best_cpu_times(
    actions: Mapping[str, Callable[[], object]], prepare: Callable[[], object] = lambda: None, rounds: int = ROUNDS
) -> dict[str, float]:
    """Smallest CPU time of each action in seconds.

    The actions take turns, so that what else the machine does falls on all alike; `prepare` comes before each and does
    not count.
    """
    times: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(rounds):
        for name, action in actions.items():
            prepare()
            begin = time.process_time()
            action()
            times[name].append(time.process_time() - begin)
    return {name: min(measured) for name, measured in times.items()}


def best_start(arguments: list[str], rounds: int = ROUNDS) -> tuple[float, float]:
    """Smallest wall time and CPU time in seconds of a Python process."""
    wall_times, cpu_times = [], []
    for _ in range(rounds):
        begin = time.perf_counter()
        process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, _, usage = os.wait4(process.pid, 0)
        wall_times.append(time.perf_counter() - begin)
        cpu_times.append(usage.ru_utime + usage.ru_stime)
        process.returncode = 0  # it has been waited for
    return min(wall_times), min(cpu_times)


def per_step(table: Table, fmi: int) -> None:
    """The stepping loop on the whole system, every component in one FMI version."""
    names = ("reference", "controller", "esc", "plant", "sensors", "fdie")
    scenario = load_scenario(SCENARIO, components={name: {"fmi": fmi} for name in names})
    with System(scenario) as system:
        alone = Stepper(system.stepper.components, None, scenario.step_size_s)
        log = np.empty((STEPS, system.wiring.width))

        masters: list[FmpyMaster] = []

        def start() -> None:
            system.initialise(scenario)
            system.stepper.advance(0, WARM_UP)
            masters[:] = [FmpyMaster(system)]

        times = best_cpu_times(
            {
                "bare doStep of all FMUs": lambda: alone.advance(WARM_UP, STEPS),
                "native stepper": lambda: system.stepper.advance(WARM_UP, STEPS),
                "native stepper with log": lambda: system.stepper.advance(WARM_UP, STEPS, log=log),
                "FMPy's own methods": lambda: masters[0].advance(WARM_UP, STEPS // SLOWER),
            },
            start,
        )
    times["FMPy's own methods"] *= SLOWER
    table.heading(f"One step of {SCENARIO}, {len(names)} FMI {fmi} FMUs, {log.shape[1]} outputs")
    for name, seconds in times.items():
        table.row(name, 1e6 * seconds / STEPS, "us")
    bare, native, _, python = times.values()
    table.row("native stepper / bare doStep", native / bare, "", at_most=1.3)
    table.row("FMPy's own methods / native stepper", python / native, "", at_least=60)


def whole_flight(table: Table) -> None:
    """A flight of 60 s and what is made of it."""
    scenario = load_scenario(SCENARIO)
    with System(scenario) as system:
        flying = best_cpu_times(
            {"stepping": lambda: system.stepper.advance(0, scenario.steps), "flight": lambda: fly(scenario, system)},
            lambda: system.initialise(scenario),
        )
        recording = fly(scenario, system)
    summary = metrics.summarise(recording)
    columns = sum(values[0].size for values in recording.signals.values())
    page = report.html(recording, summary)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "timeseries.parquet"
        writing = best_cpu_times(
            {
                "log": lambda: results.write_timeseries(recording, file),
                "report": lambda: report.html(recording, summary),
            }
        )
        size = file.stat().st_size
    table.heading(f"{SCENARIO}: {scenario.duration_s:g} s, {scenario.steps} steps")
    table.row("stepping", flying["stepping"], "s", at_most=0.1)
    table.row("flight: reset, initialise, step, log", flying["flight"], "s")
    table.row("flights per core and hour", 3600 / flying["flight"], "")
    table.row(f"writing the log of {columns} signals", writing["log"], "s")
    table.row("the same for 120 signals", writing["log"] * 120 / columns, "s", at_most=0.15)
    table.row("size of the log", size / 1e6, "MB")
    table.row("making the report", writing["report"], "s", at_most=0.5)
    table.row("size of the report", len(page.encode()) / 1e6, "MB", at_most=6)


def diagnosers(table: Table) -> None:
    """One step of each diagnoser alone, and the number of operations that it consists of."""
    names = diagnoser_ids()
    scenario = load_scenario(SCENARIO, diagnosers=names)
    with System(scenario) as system:
        alone = {name: Stepper([system.components[name]], None, scenario.step_size_s) for name in names}

        def start() -> None:
            system.initialise(scenario)
            system.stepper.advance(0, WARM_UP)

        times = best_cpu_times(
            {name: functools.partial(stepper.advance, WARM_UP, STEPS) for name, stepper in alone.items()}, start
        )
    table.heading("One step of each diagnoser")
    for name, seconds in times.items():
        table.row(name, 1e9 * seconds / STEPS, "ns")
        table.row("  operations", diagnoser_function(name).n_instructions(), "", at_most=INSTRUCTION_BUDGET)


def start_up(table: Table) -> None:
    """From a command to its effect; a machine that is busy with something else shows in the wall times."""
    table.heading("Start-up, wall time and CPU time")
    command = ["-c", "from rotordx.orchestrator.cli import main; main()"]
    for name, arguments, at_most in (
        ("python without anything", ["-c", ""], None),
        ("rotordx --help", [*command, "--help"], 0.2),
        ("rotordx run, until its first step", ["-c", FIRST_STEP], 1.0),
    ):
        wall_time, cpu_time = best_start(arguments)
        table.row(name, wall_time, "s", at_most=at_most)
        table.row("  of which CPU time", cpu_time, "s")


def main() -> None:
    """Print all figures."""
    table = Table()
    for fmi in (2, 3):
        per_step(table, fmi)
    whole_flight(table)
    diagnosers(table)
    start_up(table)


if __name__ == "__main__":
    main()
