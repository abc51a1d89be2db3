"""The figures of merit of `askf` and `msjfo` on lab_x, and what a step of each form of their filter costs.

`python -m tests.bars.kalman` (`make bars`) measures all of it and writes it to tests/bars/results; `fly_losses` and
`fly_healthy` fly a part of it, which a test does. tests/bars/lab_x.py flies both beside all other diagnosers, on
specimens with the Monte Carlo spread.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rotordx.fmus.diagnosers.codegen import INSTRUCTION_BUDGET, diagnoser_function
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.reproduction.msjfo import filter_costs as costs
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System
from tests.bars.campaign import ROTORS, markdown_table, milliseconds, or_nan, write_results

DIAGNOSERS = ("askf", "msjfo")
LOSSES = (0.1, 0.2)
ONSET_S, STEADY_S = 24.0, 5.0  #: steady so long after the onset
SIZES = ((3, 1, 1), (8, 4, 4), (12, 4, 6))  #: (n, m, p)

#: parameters of both diagnosers by what they are called here
VARIANTS: dict[str, dict[str, Any]] = {
    "as packaged": {},
    "common mode kept": {"common_mode": "kept"},
    "fixed gain": {"fixed_gain": "on"},
}
VARIANT_SEEDS = {"as packaged": 20, "common mode kept": 5, "fixed gain": 5}


@dataclass(frozen=True)
class Loss:
    """One diagnoser in one flight with a loss; delays in s from the onset, NaN if it never came to that."""

    variant: str
    diagnoser: str
    loss: float
    rotor: int
    seed: int
    detection_delay: float
    isolation_delay: float
    named: int
    mean_square_error: float  #: steady, of the four losses that the filter estimates
    verdict_mean_square_error: float  #: of loe_estimate
    gyro_innovation: float  #: normalised innovation squared per measurement of p, q, r
    velocity_innovation: float  #: the same of v_z


@dataclass(frozen=True)
class Health:
    """One diagnoser in one healthy flight."""

    variant: str
    motion: str
    diagnoser: str
    seed: int
    false_alarm: bool
    peak_ratio: float


def fly_losses(seeds: Iterable[int], losses: Sequence[float] = LOSSES, variant: str = "as packaged") -> list[Loss]:
    """Circle with the nominal vehicle in still air; every rotor loses effectiveness, one in a flight."""
    found = []
    base = _scenario("avram_circle", variant).changed(gusts=False, duration_s=ONSET_S + 12)
    with System(base) as system:
        for loss in losses:
            for rotor in ROTORS:
                for seed in seeds:
                    fault = {"rotor": rotor, "onset_s": ONSET_S, "loss_of_effectiveness": loss}
                    recording = fly(base.changed(seed=7000 + seed, faults=[fault]), system)
                    figures, signals = summarise(recording)["diagnosers"], recording.signals
                    steady = recording.time >= ONSET_S + STEADY_S
                    truth = signals["esc.loss_of_effectiveness"][steady]
                    for name in DIAGNOSERS:
                        squared = (signals[f"{name}.normalised_innovation"][recording.time > 2] ** 2).mean(axis=0)
                        found.append(
                            Loss(
                                variant,
                                name,
                                loss,
                                rotor,
                                seed,
                                or_nan(figures[name]["detection_delay_s"]),
                                or_nan(figures[name]["isolation_delay_s"]),
                                figures[name]["faulty_rotor"],
                                float(np.mean((signals[f"{name}.loss_estimate"][steady] - truth) ** 2)),
                                float(np.mean((signals[f"{name}.loe_estimate"][steady] - truth) ** 2)),
                                float(squared[1:].mean()),
                                float(squared[0]),
                            )
                        )
    return found


def fly_healthy(
    seeds: Iterable[int], motion: str = "healthy_circle", variant: str = "as packaged", **parameters: float
) -> list[Health]:
    """Healthy flights of 60 s in gusts with the nominal vehicle."""
    base = _scenario(motion, variant)
    base = base.changed(gusts=True, duration_s=60.0, parameters=base.parameters | parameters)
    name = " ".join([motion, *(f"{key} = {value:g}" for key, value in parameters.items())])
    found = []
    with System(base) as system:
        for seed in seeds:
            figures = summarise(fly(base.changed(seed=8000 + seed), system))["diagnosers"]
            for diagnoser in DIAGNOSERS:
                own = figures[diagnoser]
                peak = or_nan(own["peak_residual_ratio_before_fault"])
                found.append(Health(variant, name, diagnoser, seed, bool(own["fault_detected"]), peak))
    return found


def count_operations(sizes: Iterable[tuple[int, int, int]]) -> dict[tuple[int, int, int], dict[str, int]]:
    """Operations of a step of every form at every size."""
    return {size: {form: costs.operations(function(*size)) for form, function in costs.FORMS.items()} for size in sizes}


def _scenario(name: str, variant: str) -> Any:
    components = {diagnoser: {"parameters": VARIANTS[variant]} for diagnoser in DIAGNOSERS}
    return load_scenario(name, diagnosers=list(DIAGNOSERS), components=components)


def loss_table(losses: Sequence[Loss]) -> list[str]:
    """Markdown table; delays as median (maximum) in ms."""
    columns = ["variant", "diagnoser", "loss", "flights", "detected", "isolated", "wrong rotor"]
    columns += ["mean square error: gamma, verdict", "innovation: p, q, r; v_z"]
    rows = []
    for variant, name, loss in sorted({(f.variant, f.diagnoser, f.loss) for f in losses}):
        own = [f for f in losses if (f.variant, f.diagnoser, f.loss) == (variant, name, loss)]
        rows.append(
            (
                *(variant, f"`{name}`", f"{100 * loss:.0f} %", len(own)),
                milliseconds([f.detection_delay for f in own]),
                milliseconds([f.isolation_delay for f in own]),
                sum(f.named != f.rotor for f in own),
                f"{_mean(own, 'mean_square_error'):.1e}, {_mean(own, 'verdict_mean_square_error'):.1e}",
                f"{_mean(own, 'gyro_innovation'):.3f}; {_mean(own, 'velocity_innovation'):.2f}",
            )
        )
    return markdown_table(columns, rows)


def _mean(losses: Sequence[Loss], field: str) -> float:
    return float(np.mean([getattr(f, field) for f in losses]))


def health_table(healthy: Sequence[Health]) -> list[str]:
    """Markdown table of the healthy flights."""
    rows = []
    for variant, motion, name in sorted({(h.variant, h.motion, h.diagnoser) for h in healthy}):
        own = [h for h in healthy if (h.variant, h.motion, h.diagnoser) == (variant, motion, name)]
        alarms, peak = sum(h.false_alarm for h in own), max(h.peak_ratio for h in own)
        rows.append((variant, motion, f"`{name}`", len(own), alarms, f"{peak:.2f}"))
    columns = ["variant", "motion", "diagnoser", "flights", "false alarms", "peak residual over threshold"]
    return markdown_table(columns, rows)


def cost_tables() -> list[str]:
    """Markdown tables: operations and CPU time of the forms, and of the diagnosers' whole steps."""
    counted = count_operations(SIZES)
    with tempfile.TemporaryDirectory() as folder:
        times = {
            (size, form): costs.measured_seconds(costs.FORMS[form](*size), Path(folder) / f"{size}{i}")
            for size in SIZES
            for i, form in enumerate(costs.FORMS)
        }
    by_form = []
    for form in costs.FORMS:
        cells = []
        for size in SIZES:
            own, dense = counted[size][form], counted[size]["ASKF, dense"]
            seconds = times[size, form]
            timed = "" if seconds is None else f", {1e9 * seconds:.0f} ns"
            cells.append(f"{own} ({own / dense:.2f}){timed}")
        by_form.append((form, *cells))
    steps = [(f"`{name}`", diagnoser_function(name).n_instructions(), INSTRUCTION_BUDGET) for name in DIAGNOSERS]
    return [
        *markdown_table(["form", *(f"n, m, p = {', '.join(map(str, size))}" for size in SIZES)], by_form),
        "",
        *markdown_table(["diagnoser", "instructions of a step", "budget"], steps),
    ]


def main() -> None:
    """Measure everything and write results/kalman.md and results/kalman.json."""
    begin = time.perf_counter()
    losses: list[Loss] = []
    healthy: list[Health] = []
    for variant, seeds in VARIANT_SEEDS.items():
        losses += fly_losses(range(seeds), variant=variant)
        healthy += fly_healthy(range(seeds), variant=variant)
        healthy += fly_healthy(range(seeds), "roll_sine", variant)
        healthy += fly_healthy(range(seeds), "vertical_sine", variant, angular_rate=3.0)
    lines = [
        "# `askf` and `msjfo` on lab_x",
        "",
        f"Circles of the nominal vehicle in still air, a loss at {ONSET_S:g} s. Delays after it in ms: median "
        f"(maximum); mean square errors from {STEADY_S:g} s after it on. Innovations squared are normalised; v_z's "
        "are small because a captured position, and its error, is held for five samples.",
        "",
        *loss_table(losses),
        "",
        "Healthy flights of 60 s in gusts.",
        "",
        *health_table(healthy),
        "",
        "A step of each form of the filter: operations (over those of the dense ASKF) and CPU time as compiled C.",
        "",
        *cost_tables(),
    ]
    write_results("kalman", lines, {"losses": [asdict(f) for f in losses], "healthy": [asdict(h) for h in healthy]})
    print(f"\n{(len(losses) + len(healthy)) // 2} flights in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
