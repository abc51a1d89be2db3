"""The figures of merit of `fdie` over simulated specimens of lab_x, each identified on its own healthy flights.

`python -m tests.bars.fdie` (`make bars`) flies all of it on two processes and writes its figures to
tests/bars/results; `fly_all` flies a part of it, which a test does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
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
from tests.bars.campaign import (
    ROTORS,
    markdown_table,
    milliseconds,
    or_nan,
    processes,
    share,
    share_and_milliseconds,
    write_results,
)

SPECIMENS = 10
LOSSES = (0.05, 0.1, 0.2, 0.3, 0.4)
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
        peak = or_nan(figures["peak_residual_ratio_before_fault"])
        return Healthy(self.number, motion, seed, figures["false_alarm"], peak)

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
            or_nan(figures["detection_delay_s"]),
            or_nan(figures["isolation_delay_s"]),
            figures["faulty_rotor"],
            signals["fdie.paper_isolation_time"][-1] - ONSET_S,
            round(signals["fdie.paper_rotor"][-1]),
            float(np.max(np.abs(estimate[recording.time >= ONSET_S + 1.0] - loss))),
            or_nan(figures["loe_final_error"]),
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
    with processes(workers) as pool:
        jobs = [pool.submit(fly_specimen, number, circles, sines, losses, rotors) for number in specimens]
        for done, job in enumerate(jobs, 1):
            flown = job.result()
            healthy += flown[0]
            faulty += flown[1]
            print(f"specimen {done} of {len(jobs)}", file=sys.stderr, flush=True)
    return healthy, faulty


def table(faulty: Sequence[Faulty]) -> list[str]:
    """Markdown table of what happened to each loss; delays as median and maximum in ms."""
    columns = ["loss", "flights", "detected", "delay", "paper's rule isolates", "set membership isolates"]
    columns += ["wrong rotor", "largest error from 1 s on", "largest final error"]
    rows = []
    for loss in sorted({f.loss for f in faulty}):
        own = [f for f in faulty if f.loss == loss]
        detection = [f.detection_delay for f in own]
        rows.append(
            (
                f"{100 * loss:.0f} %",
                len(own),
                share(detection),
                milliseconds(detection),
                share_and_milliseconds([f.paper_isolation_delay for f in own]),
                share_and_milliseconds([f.isolation_delay for f in own]),
                sum(f.named not in (0, f.rotor) or f.paper_named not in (0, f.rotor) for f in own),
                f"{max(f.error_after_1_s for f in own):.3f}",
                f"{max(abs(f.final_error) for f in own):.4f}",
            )
        )
    return markdown_table(columns, rows)


def healthy_table(healthy: Sequence[Healthy]) -> list[str]:
    """Markdown table of the healthy flights by motion."""
    rows = []
    for motion in sorted({h.motion for h in healthy}):
        own = [h for h in healthy if h.motion == motion]
        name = motion if motion == "circle" else f"vertical sine at {motion} rad/s"
        rows.append((name, len(own), sum(h.false_alarm for h in own), f"{max(h.peak_ratio for h in own):.2f}"))
    return markdown_table(["motion", "flights", "false alarms", "peak residual over threshold"], rows)


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
    write_results("fdie", lines, {"healthy": [asdict(h) for h in healthy], "faulty": [asdict(f) for f in faulty]})
    print(f"\n{len(healthy) + len(faulty)} flights in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
