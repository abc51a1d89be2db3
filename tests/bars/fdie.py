"""The figures of merit of `fdie` over simulated specimens of lab_x, each identified on its own healthy flights.

`python -m tests.bars.fdie` (`make bars`) flies all of it on two processes and writes its figures to
tests/bars/results; `Campaign` flies a part of it, which a test does.
"""

from __future__ import annotations

import json
import multiprocessing
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rotordx.fmus.vehicles import Vehicle, load_vehicle
from rotordx.fmus.vehicles.spread import perturbed
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.healthy_flights import identify_in_simulation
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System

RESULTS = Path(__file__).parent / "results"
SPECIMENS = 10
LOSSES = (0.05, 0.1, 0.2, 0.3, 0.4)
ROTORS = (1, 2, 3, 4)
ONSET_S = 24.0
CIRCLES_PER_SPECIMEN = 30
SINES_PER_SPECIMEN = 4  # at 2 and 3 rad/s in turn
SINE_RATES = (2.0, 3.0)


@dataclass(frozen=True)
class Healthy:
    """One healthy flight."""

    specimen: int
    motion: str
    seed: int
    false_alarm: bool
    peak_ratio: float


@dataclass(frozen=True)
class Faulty:
    """One flight with a loss; delays in s from its onset, NaN if it never came to that."""

    specimen: int
    rotor: int
    loss: float
    false_alarm: bool
    detection_delay: float
    isolation_delay: float
    named: int
    paper_isolation_delay: float
    paper_named: int
    error_after_1_s: float
    final_error: float


class Specimen:
    """One simulated vehicle and its identified `fdie`."""

    def __init__(self, number: int):
        self.number = number
        self.vehicle: Vehicle = perturbed(load_vehicle("lab_x"), np.random.default_rng(1000 + number))
        design = identify_in_simulation("lab_x", seed=100 * (number + 1), actual_vehicle=self.vehicle)
        self.components = {"fdie": {"parameters": dict(design.parameters)}}
        self.systems: dict[str, System] = {}

    def fly(self, name: str, **changes: Any) -> Recording:
        """Fly a packaged scenario, changed, with this vehicle."""
        scenario: Scenario = load_scenario(name, components=self.components)
        if name not in self.systems:
            self.systems[name] = System(scenario)
        parameters = scenario.parameters | changes.pop("parameters", {})
        return fly(scenario.changed(parameters=parameters, **changes), self.systems[name], actual_vehicle=self.vehicle)

    def healthy(self, motion: str, seed: int) -> Healthy:
        """Fly the circle, or a vertical sine at a rate given in rad/s."""
        if motion == "circle":
            recording = self.fly("healthy_circle", seed=seed)
        else:
            recording = self.fly("vertical_sine", seed=seed, parameters={"angular_rate": float(motion)})
        figures = summarise(recording)["diagnosers"]["fdie"]
        peak = figures["peak_residual_ratio_before_fault"]
        return Healthy(self.number, motion, seed, figures["false_alarm"], np.nan if peak is None else peak)

    def faulty(self, rotor: int, loss: float, seed: int) -> Faulty:
        """Fly the circle and lose effectiveness in one rotor."""
        fault = {"rotor": rotor, "onset_s": ONSET_S, "loss_of_effectiveness": loss}
        recording = self.fly("avram_circle", seed=seed, duration_s=36.0, faults=[fault])
        figures = summarise(recording)["diagnosers"]["fdie"]
        signals = recording.signals
        estimate = signals["fdie.loe_estimate"][:, rotor - 1]
        return Faulty(
            self.number,
            rotor,
            loss,
            figures["false_alarm"],
            _number(figures["detection_delay_s"]),
            _number(figures["isolation_delay_s"]),
            figures["faulty_rotor"],
            signals["fdie.paper_isolation_time"][-1] - ONSET_S,
            round(signals["fdie.paper_rotor"][-1]),
            float(np.max(np.abs(estimate[recording.time >= ONSET_S + 1.0] - loss))),
            _number(figures["loe_final_error"]),
        )

    def close(self) -> None:
        """Free the FMUs."""
        for system in self.systems.values():
            system.close()


def fly_specimen(
    number: int, circles: int, sines: int, losses: Sequence[float], rotors: Sequence[int]
) -> tuple[list[Healthy], list[Faulty]]:
    """All flights of one specimen; none of their seeds is one of an identification flight."""
    specimen = Specimen(number)
    try:
        healthy = [specimen.healthy("circle", 50000 + 100 * number + i) for i in range(circles)]
        healthy += [
            specimen.healthy(str(SINE_RATES[i % len(SINE_RATES)]), 60000 + 100 * number + i) for i in range(sines)
        ]
        faulty = [specimen.faulty(rotor, loss, 90000 + 100 * number + rotor) for loss in losses for rotor in rotors]
    finally:
        specimen.close()
    return healthy, faulty


def fly_all(
    specimens: Iterable[int], circles: int, sines: int, losses: Sequence[float], rotors: Sequence[int], workers: int
) -> tuple[list[Healthy], list[Faulty]]:
    """All flights of several specimens, spread over processes."""
    healthy: list[Healthy] = []
    faulty: list[Faulty] = []
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        jobs = [pool.submit(fly_specimen, number, circles, sines, losses, rotors) for number in specimens]
        for done, job in enumerate(jobs, 1):
            flown = job.result()
            healthy += flown[0]
            faulty += flown[1]
            print(f"specimen {done} of {len(jobs)}", file=sys.stderr, flush=True)
    return healthy, faulty


def table(faulty: Sequence[Faulty]) -> list[str]:
    """Markdown table of what happened to each loss; delays as median and maximum in ms."""
    lines = [
        "| loss | flights | detected | delay | paper's rule isolates | set membership isolates | wrong rotor "
        "| largest error from 1 s on | largest final error |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for loss in sorted({f.loss for f in faulty}):
        rows = [f for f in faulty if f.loss == loss]
        wrong = sum(f.named not in (0, f.rotor) or f.paper_named not in (0, f.rotor) for f in rows)
        lines.append(
            f"| {100 * loss:.0f} % | {len(rows)} | {_delays([f.detection_delay for f in rows], percent_only=True)} "
            f"| {_delays([f.detection_delay for f in rows])} "
            f"| {_delays([f.paper_isolation_delay for f in rows], percent=True)} "
            f"| {_delays([f.isolation_delay for f in rows], percent=True)} | {wrong} "
            f"| {max(f.error_after_1_s for f in rows):.3f} | {max(abs(f.final_error) for f in rows):.4f} |"
        )
    return lines


def healthy_table(healthy: Sequence[Healthy]) -> list[str]:
    """Markdown table of the healthy flights by motion."""
    lines = ["| motion | flights | false alarms | peak residual over threshold |", "|---|---|---|---|"]
    for motion in sorted({h.motion for h in healthy}):
        rows = [h for h in healthy if h.motion == motion]
        name = motion if motion == "circle" else f"vertical sine at {motion} rad/s"
        lines.append(
            f"| {name} | {len(rows)} | {sum(h.false_alarm for h in rows)} | {max(h.peak_ratio for h in rows):.2f} |"
        )
    return lines


def _delays(delays: Sequence[float], percent: bool = False, percent_only: bool = False) -> str:
    reached = np.array([d for d in delays if np.isfinite(d)])
    share = f"{100 * len(reached) / len(delays):.0f} %"
    if percent_only or not len(reached):
        return share
    figures = f"{1000 * np.median(reached):.0f} ({1000 * reached.max():.0f})"
    return f"{share}, {figures}" if percent else figures


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def main() -> None:
    """Fly everything and write results/fdie.md and results/fdie.json."""
    begin = time.perf_counter()
    healthy, faulty = fly_all(range(SPECIMENS), CIRCLES_PER_SPECIMEN, SINES_PER_SPECIMEN, LOSSES, ROTORS, workers=2)
    lines = [
        "# `fdie` on simulated specimens of lab_x",
        "",
        f"{SPECIMENS} specimens with the spread of the benchmark, battery sag and gusts, each with bounds identified "
        f"on its own three healthy circles. Losses begin at {ONSET_S:g} s. Delays after the onset in ms: median "
        "(maximum).",
        "",
        *table(faulty),
        "",
        *healthy_table(healthy),
    ]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "fdie.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    flights = {"healthy": [asdict(h) for h in healthy], "faulty": [asdict(f) for f in faulty]}
    (RESULTS / "fdie.json").write_text(json.dumps(flights) + "\n", encoding="utf-8")
    print("\n".join(lines))
    print(f"\n{len(healthy) + len(faulty)} flights in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
