"""The figures of merit of `thau`, `adaptive_thau` and `asmto` on the F450 of their paper.

`python -m tests.bars.thau` (`make bars`) flies all of it and writes its figures to tests/bars/results; `measure` flies
a part of it, which a test does.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.spread import perturbed
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.reproduction.motor_offsets import missing_thrust, offsets_if_alone
from rotordx.orchestrator.reproduction.nguyen_hong.accuracy import accuracy
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from tests.bars.campaign import ROTORS, markdown_table, write_results

DIAGNOSERS = ("thau", "adaptive_thau", "asmto")
SEEDS, HEALTHY_FLIGHTS, SPECIMENS = 100, 50, 50


@dataclass(frozen=True)
class Estimation:
    """One diagnoser in flights with a loss of 30 %; the worst of all, times in s from the onset."""

    experiment: str
    diagnoser: str
    flights: int
    detection_delay: float
    isolation_delay: float
    wrong_rotor: int
    settling_time: float
    bias: float
    std: float


@dataclass(frozen=True)
class Health:
    """One diagnoser in healthy flights."""

    experiment: str
    diagnoser: str
    flights: int
    false_alarms: int
    peak_ratio: float


@dataclass(frozen=True)
class Measured:
    """Everything."""

    estimation: list[Estimation]
    health: list[Health]
    varying_rms: float  #: N, of asmto under a time-varying fault, from 1 s on
    largest_sliding_gain: float  #: rad/s2, in a healthy flight of 10 min


def measure(seeds: int, healthy_flights: int, specimens: int) -> Measured:
    """Fly it.

    Args:
        seeds: flights of each experiment.
        healthy_flights: of the nominal vehicle.
        specimens: vehicles that differ from the nominal one, one healthy flight each.
    """
    quiet: dict[str, Any] = {"sensor_noise": False, "gusts": False}
    fast, slow = load_scenario("nguyen_hong_motor_1"), load_scenario("nguyen_hong_400_hz")
    estimation = [
        *_estimated("500 Hz", fast, seeds, [1]),
        *_estimated("400 Hz", slow, seeds, [1]),
        *_estimated("any motor", fast, max(1, seeds // 4), ROTORS),
        *_estimated("no noise", fast.changed(**quiet), 1, ROTORS),
    ]
    healthy = load_scenario("nguyen_hong_healthy")
    health = [*_healthy("nominal", healthy, healthy_flights, False), *_healthy("spread", healthy, specimens, True)]
    varying = fly(load_scenario("nguyen_hong_time_varying"))
    later = varying.time > varying.faults[0]["onset_s"] + 1
    error = (offsets_if_alone(varying, "asmto") - missing_thrust(varying))[later, 0]
    long = fly(load_scenario("nguyen_hong_healthy", diagnosers=["asmto"], duration_s=600.0), log_every=5)
    gain = float(long.signals["asmto.sliding_gain"].max())
    return Measured(estimation, health, float(np.sqrt(np.mean(error**2))), gain)


def _estimated(name: str, scenario: Scenario, seeds: int, rotors: Any) -> list[Estimation]:
    found: dict[str, list[tuple[float, ...]]] = {d: [] for d in DIAGNOSERS}
    with System(scenario) as system:
        for seed in range(seeds):
            for rotor in rotors:
                faults = [scenario.plain()["faults"][0] | {"rotor": rotor}]
                recording = fly(scenario.changed(seed=seed, faults=faults), system)
                verdicts = summarise(recording)["diagnosers"]
                for d in DIAGNOSERS:
                    v, a = verdicts[d], accuracy(recording, d)
                    delays = [np.inf if v[k] is None else v[k] for k in ("detection_delay_s", "isolation_delay_s")]
                    wrong = v["faulty_rotor"] not in (0, rotor)
                    found[d].append((*delays, wrong, a.settling_time, abs(a.bias), a.std))
    rows = []
    for d in DIAGNOSERS:
        detection, isolation, wrong, settling, bias, std = np.array(found[d], dtype=float).T
        worst = [float(values.max()) for values in (settling, bias, std)]
        count = len(detection)
        rows.append(
            Estimation(name, d, count, float(detection.max()), float(isolation.max()), int(wrong.sum()), *worst)
        )
    return rows


def _healthy(name: str, scenario: Scenario, flights: int, spread: bool) -> list[Health]:
    alarms, peaks = dict.fromkeys(DIAGNOSERS, 0), dict.fromkeys(DIAGNOSERS, 0.0)
    nominal = load_vehicle(scenario.vehicle)
    with System(scenario) as system:
        for i in range(flights):
            actual = perturbed(nominal, np.random.default_rng(i)) if spread else None
            recording = fly(scenario.changed(seed=1000 + i), system, actual_vehicle=actual)
            for d, verdict in summarise(recording)["diagnosers"].items():
                alarms[d] += verdict["fault_detected"]
                ratio = np.abs(recording.signals[f"{d}.residual"]) / recording.signals[f"{d}.threshold"]
                peaks[d] = max(peaks[d], float(np.nanmax(ratio)))
    return [Health(name, d, flights, alarms[d], peaks[d]) for d in DIAGNOSERS]


def report(measured: Measured) -> list[str]:
    """Markdown tables."""
    columns = ["experiment", "diagnoser", "flights", "detected, ms", "named, ms", "wrong rotor"]
    columns += ["settled, ms", "bias, %", "spread, N"]
    estimation = [
        (
            *(e.experiment, f"`{e.diagnoser}`", e.flights),
            *(f"{1000 * t:.1f}" for t in (e.detection_delay, e.isolation_delay)),
            *(e.wrong_rotor, f"{1000 * e.settling_time:.1f}", f"{100 * e.bias:.2f}", f"{e.std:.4f}"),
        )
        for e in measured.estimation
    ]
    health = [
        (h.experiment, f"`{h.diagnoser}`", h.flights, h.false_alarms, f"{h.peak_ratio:.2f}") for h in measured.health
    ]
    return [
        "# `thau`, `adaptive_thau` and `asmto` on the F450",
        "",
        "Loss of 30 % in attitude flight with sensor noise and gusts. The offset is the thrust that the failed motor "
        "lacks, some 2.1 N; its estimate has settled when it stays within 5 % of it. Each figure is the worst of all "
        "flights.",
        "",
        *markdown_table(columns, estimation),
        "",
        "Healthy flights of 60 s, of the nominal vehicle and of vehicles with the benchmark's spread:",
        "",
        *markdown_table(["vehicles", "diagnoser", "flights", "false alarms", "peak residual over threshold"], health),
        "",
        f"A loss of (20 + 10 sin 3t) % is followed by `asmto` to {measured.varying_rms:.3f} N rms. In a healthy noisy "
        f"flight of 10 min its sliding gain reaches {measured.largest_sliding_gain:.2g} rad/s2.",
    ]


def main() -> None:
    """Fly everything and write results/thau.md and results/thau.json."""
    begin = time.perf_counter()
    measured = measure(SEEDS, HEALTHY_FLIGHTS, SPECIMENS)
    write_results("thau", report(measured), asdict(measured))
    print(f"\nflown in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
