"""The figures of merit of `rho_adaptive` beside `smo`: paper 003's faults, its threshold, and flights of lab_x.

`python -m tests.bars.rho_adaptive` (`make bars`) flies all of it and writes its figures to tests/bars/results; tests in
tests/rho_adaptive fly a part. Side by side with the other diagnosers they are in `tests.bars.lab_x`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.reproduction.rho_adaptive.attitude_experiments import Outcome, experiments, outcomes
from rotordx.orchestrator.reproduction.rho_adaptive.fault_free import fault_free_runs
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System
from tests.bars.campaign import ROTORS, markdown_table, milliseconds, or_nan, write_results

DIAGNOSERS = ["rho_adaptive", "smo"]
RUNS, CONTROL_RUNS = 900, 60
SEEDS = 10
ONSET_S, STEADY_S, DURATION_S = 24.0, 30.0, 40.0
GROWTH_RATE = 0.5  # 1/s, of paper 003's incipient fault


@dataclass(frozen=True)
class Kind:
    """What happens in some flights of the circle."""

    loss: float
    incipient: bool = False
    gusts: bool = True

    def __str__(self) -> str:
        grown = f"{self.loss:.0%}, growing" if self.incipient else f"{self.loss:.0%}"
        return grown if self.gusts else f"{grown}, still air"


KINDS = (Kind(0.2), Kind(0.1), Kind(0.2, incipient=True), Kind(0.1, incipient=True), Kind(0.2, gusts=False))


@dataclass(frozen=True)
class Flown:
    """What a diagnoser said on one flight; delays in s from the onset, NaN if it never came to that."""

    kind: str
    diagnoser: str
    rotor: int
    seed: int
    detection_delay: float
    isolation_delay: float
    named: int
    mean_square_error: float  #: of the failed rotor's loss from STEADY_S on


def fly_kind(kind: Kind, seeds: int) -> list[Flown]:
    """All rotors, several seeds each."""
    scenario = load_scenario("avram_circle", diagnosers=DIAGNOSERS, duration_s=DURATION_S, gusts=kind.gusts)
    fault: dict[str, Any] = {"onset_s": ONSET_S, "loss_of_effectiveness": kind.loss}
    if kind.incipient:
        fault |= {"profile": "incipient", "growth_rate_per_s": GROWTH_RATE}
    found = []
    with System(scenario) as system:
        for seed in range(seeds):
            for rotor in ROTORS:
                recording = fly(scenario.changed(seed=7000 + seed, faults=[fault | {"rotor": rotor}]), system)
                late = recording.time >= STEADY_S
                truth = recording.signals["esc.loss_of_effectiveness"]
                for name, score in summarise(recording)["diagnosers"].items():
                    error = (recording.signals[f"{name}.loe_estimate"] - truth)[late, rotor - 1]
                    delays = (or_nan(score["detection_delay_s"]), or_nan(score["isolation_delay_s"]))
                    mean_square = float(np.mean(error**2))
                    found.append(Flown(str(kind), name, rotor, seed, *delays, score["faulty_rotor"], mean_square))
    return found


def attitude_table(found: dict[str, Outcome]) -> list[str]:
    """Markdown table of the paper's faults on its attitude system."""
    rows = [
        (
            name,
            f"`{diagnoser}`",
            f"{outcome.detection_time[diagnoser]:.3f}",
            f"{outcome.mean_squared_error(diagnoser):.1e}",
            f"{outcome.error_of_zero():.1e}",
        )
        for name, outcome in found.items()
        for diagnoser in DIAGNOSERS
    ]
    return markdown_table(["fault, condition", "diagnoser", "detected at, s", "mean square error", "of zero"], rows)


def flight_table(flown: Sequence[Flown]) -> list[str]:
    """Markdown table of the flights; delays as median (maximum) in ms."""
    columns = ["loss", "diagnoser", "flights", "detected", "isolated", "wrong rotor"]
    columns += ["mean square error: median (largest)"]
    rows = []
    for kind in KINDS:
        for name in DIAGNOSERS:
            own = [f for f in flown if (f.kind, f.diagnoser) == (str(kind), name)]
            errors = [f.mean_square_error for f in own]
            rows.append(
                (
                    *(kind, f"`{name}`", len(own)),
                    milliseconds([f.detection_delay for f in own]),
                    milliseconds([f.isolation_delay for f in own]),
                    sum(f.named != f.rotor for f in own),
                    f"{np.median(errors):.1e} ({max(errors):.1e})",
                )
            )
    return markdown_table(columns, rows)


def main() -> None:
    """Fly everything and write results/rho_adaptive.md and results/rho_adaptive.json."""
    begin = time.perf_counter()
    aware, unaware = fault_free_runs(RUNS, seed=10), fault_free_runs(CONTROL_RUNS, seed=11, bounds_in_threshold=False)
    found = {name: e for name, e in experiments().items() if name.startswith(("incipient", "abrupt"))}
    attitude = outcomes(found)
    flown: list[Flown] = []
    for kind in KINDS:
        flown += fly_kind(kind, SEEDS)
        print(kind, file=sys.stderr, flush=True)
    lines = [
        "# `rho_adaptive` and `smo`",
        "",
        "## Paper 003 on its attitude system",
        "",
        f"J_nu stayed below J_th in {np.mean(aware.ratio <= 1):.1%} of {RUNS} random fault-free runs, largest ratio "
        f"{aware.ratio.max():.3f}; with uncertainty and noise taken out of J_th, {np.mean(unaware.ratio > 1):.0%} of "
        f"{CONTROL_RUNS} alarmed.",
        "",
        *attitude_table(attitude),
        "",
        "## lab_x in closed loop",
        "",
        f"Circles of the nominal vehicle in gusts, {SEEDS} seeds for each rotor, losses from {ONSET_S:g} s on; those "
        f"that grow do so at {GROWTH_RATE:g} 1/s. Delays after the onset in ms: median (maximum). Errors from "
        f"{STEADY_S:g} s on.",
        "",
        *flight_table(flown),
    ]
    figures = {
        "fault_free_ratio": np.round(aware.ratio, 4).tolist(),
        "control_ratio": np.round(unaware.ratio, 4).tolist(),
        "flights": [asdict(f) for f in flown],
    }
    write_results("rho_adaptive", lines, figures)
    print(f"\n{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
