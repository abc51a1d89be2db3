"""All fault observers side by side: the same flights of lab_x for each, nominal and with the Monte Carlo spread.

Diagnosers do not act on the flight, so that one flight serves all of them. `fdie` is left out: its bounds are
identified for each specimen, which `fdie.py` does. `python -m tests.bars.lab_x` (`make bars`) flies all of it on
two processes and writes its figures to tests/bars/results; `fly_part` flies a part of it, which a test does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.spread import perturbed
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System
from tests.bars.campaign import ROTORS, markdown_table, or_nan, processes, share_and_milliseconds, write_results

DIAGNOSERS = [name for name in diagnoser_ids() if name not in ("null", "fdie")]
ONSET_S = 24.0
STEADY_S = 2.0  #: after the onset, from which the estimate should have settled


@dataclass(frozen=True)
class Flight:
    """What to fly; `specimen` None is the nominal vehicle, `loss` 0 a healthy flight."""

    kind: str
    seed: int
    specimen: int | None = None
    rotor: int = 0
    loss: float = 0.0
    incipient: bool = False


@dataclass(frozen=True)
class Result:
    """What one diagnoser said on a flight; delays in s from the onset, NaN if it never came to that."""

    diagnoser: str
    flight: Flight
    false_alarm: bool
    peak_ratio: float
    detection_delay: float
    isolation_delay: float
    named: int
    mean_error: float  #: of the failed rotor's estimate once settled
    mean_square_error: float


def healthy_flights(count: int) -> list[Flight]:
    """Circles of 60 s, each of another specimen."""
    return [Flight("healthy", 3000 + i, specimen=i) for i in range(count)]


def faulty_flights(seeds: int) -> list[Flight]:
    """Losses on every rotor: of the nominal vehicle, incipient ones, and of specimens."""
    flights = []
    for seed in range(seeds):
        for rotor in ROTORS:
            for loss in (0.1, 0.2):
                flights.append(Flight(f"{100 * loss:.0f} %", 4000 + seed, None, rotor, loss))
            flights.append(Flight("30 % incipient", 5000 + seed, None, rotor, 0.3, incipient=True))
            flights.append(Flight("20 %, specimens", 6000 + 4 * seed + rotor, 100 + 4 * seed + rotor, rotor, 0.2))
    return flights


def fly_part(flights: Sequence[Flight]) -> list[Result]:
    """Fly some flights, all diagnosers aboard."""
    scenario = load_scenario("avram_circle", diagnosers=DIAGNOSERS)
    nominal = load_vehicle("lab_x")
    results = []
    with System(scenario) as system:
        for flight in flights:
            vehicle = None if flight.specimen is None else perturbed(nominal, np.random.default_rng(flight.specimen))
            changes: dict[str, Any] = {"seed": flight.seed, "faults": [], "duration_s": 60.0}
            if flight.loss:
                fault: dict[str, Any] = {
                    "rotor": flight.rotor,
                    "onset_s": ONSET_S,
                    "loss_of_effectiveness": flight.loss,
                }
                if flight.incipient:
                    fault |= {"profile": "incipient", "growth_rate_per_s": 0.5}
                changes |= {"faults": [fault], "duration_s": 36.0}
            recording = fly(scenario.changed(**changes), system, actual_vehicle=vehicle)
            figures = summarise(recording)["diagnosers"]
            settled = recording.time >= ONSET_S + STEADY_S
            truth = recording.signals["esc.loss_of_effectiveness"]
            for name in DIAGNOSERS:
                error = (recording.signals[f"{name}.loe_estimate"] - truth)[settled, max(flight.rotor, 1) - 1]
                results.append(_result(name, flight, figures[name], error))
    return results


def _result(name: str, flight: Flight, figures: dict[str, Any], error: np.ndarray) -> Result:
    return Result(
        name,
        flight,
        bool(figures["false_alarm"]),
        or_nan(figures["peak_residual_ratio_before_fault"]),
        or_nan(figures["detection_delay_s"]),
        or_nan(figures["isolation_delay_s"]),
        figures["faulty_rotor"],
        float(np.mean(error)),
        float(np.mean(error**2)),
    )


def fly_all(flights: Sequence[Flight], workers: int) -> list[Result]:
    """All flights, spread over processes."""
    parts = [flights[i : i + 10] for i in range(0, len(flights), 10)]
    results: list[Result] = []
    with processes(workers) as pool:
        for done, part in enumerate(pool.map(fly_part, parts), 1):
            results += part
            print(f"{min(10 * done, len(flights))} of {len(flights)} flights", file=sys.stderr, flush=True)
    return results


def healthy_table(results: Iterable[Result]) -> list[str]:
    """Markdown table of the healthy flights."""
    rows = []
    healthy = [r for r in results if not r.flight.loss]
    for name in DIAGNOSERS:
        own = [r for r in healthy if r.diagnoser == name]
        peak = np.nanmax([r.peak_ratio for r in own])
        rows.append((f"`{name}`", len(own), sum(r.false_alarm for r in own), f"{peak:.2f}"))
    return markdown_table(["diagnoser", "flights", "false alarms", "peak residual over threshold"], rows)


def fault_table(results: Iterable[Result], kind: str) -> list[str]:
    """Markdown table of the flights with one kind of loss; delays as median and maximum in ms."""
    columns = ["diagnoser", "flights", "detected", "isolated", "wrong rotor"]
    columns += ["largest mean error", "largest mean square error"]
    rows = []
    faulty = [r for r in results if r.flight.kind == kind]
    for name in DIAGNOSERS:
        own = [r for r in faulty if r.diagnoser == name]
        rows.append(
            (
                f"`{name}`",
                len(own),
                share_and_milliseconds([r.detection_delay for r in own]),
                share_and_milliseconds([r.isolation_delay for r in own]),
                sum(r.named not in (0, r.flight.rotor) for r in own),
                f"{max(abs(r.mean_error) for r in own):.4f}",
                f"{max(r.mean_square_error for r in own):.1e}",
            )
        )
    return markdown_table(columns, rows)


def main() -> None:
    """Fly everything and write results/lab_x.md and results/lab_x.json."""
    begin = time.perf_counter()
    flights = [*healthy_flights(50), *faulty_flights(5)]
    results = fly_all(flights, workers=2)
    lines = [
        "# Fault observers on lab_x",
        "",
        "Circles in gusts, designs of the nominal vehicle. Healthy flights and specimens have the spread of the "
        f"benchmark and battery sag. Losses begin at {ONSET_S:g} s. Delays after the onset in ms: median (maximum); "
        f"errors of the failed rotor's estimate from {STEADY_S:g} s after the onset on.",
        "",
        *healthy_table(results),
    ]
    for kind in dict.fromkeys(f.kind for f in flights if f.loss):
        lines += ["", f"## {kind}", "", *fault_table(results, kind)]
    write_results("lab_x", lines, [asdict(r) for r in results])
    print(f"\n{len(flights)} flights in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
