"""The figures of merit of `hinf` and `fast_adaptive` on the vehicle of Ren's paper, over many seeds of sensor noise.

`python -m tests.bars.hinf` (`make bars`) flies all of it on two processes and writes its figures to tests/bars/results;
the functions fly a part of it, which a test does.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains.flight_model import flight_model
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.reproduction.ren.rotor_losses import losses, repeated, state_errors
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from tests.bars.campaign import ROTORS, markdown_table, processes, write_results

SEEDS = 100
LOSSES = (0.1, 0.2, 0.3, 0.4, 0.5)
ONSET_S, DURATION_S = 12.0, 24.0

#: the two models of hinf, and the baseline
DIAGNOSERS = ("hinf", "hinf_tau3", "fast_adaptive")
TAU3 = {"hinf_tau3": {"fmu": "hinf", "parameters": {"fault_model": "tau3"}}}

#: about roll, pitch, yaw (front, right, down), rad/s2: [0.5, -0.5, 0.5] in the paper's axes
DISTURBANCE = (0.5, 0.5, -0.5)


@dataclass(frozen=True)
class Row:
    """One loss of one rotor, estimated by one diagnoser; losses are fractions, times s after the onset."""

    diagnoser: str
    rotor: int
    loss: float
    settling_time: float
    quiet_settling_time: float  #: without noise
    bias: float
    std: float
    largest_std: float  #: of all four rotors
    ghost: float
    named: float  #: share of flights in which that rotor is named
    state_rms: tuple[float, ...]  #: roll, pitch, yaw, p, q, r, in rad and rad/s, from calibration to the end
    velocity_rms: float  #: of v_z, m/s


def nominal(**changes: object) -> Scenario:
    """Scenario A without disturbance and uncertainty, cut short; the diagnosers side by side."""
    base = load_scenario("ren_scenario_a")
    still = base.parameters | {"constant_disturbance": [0.0] * 6}
    return base.changed(
        **{"parameters": still, "components": TAU3, "diagnosers": list(DIAGNOSERS), "duration_s": DURATION_S} | changes
    )


def proportional(rotor: int, loss: float, seeds: int) -> list[Row]:
    """Fly a step of a loss."""
    fault = {"rotor": rotor, "onset_s": ONSET_S, "loss_of_effectiveness": loss}
    named = dict.fromkeys(DIAGNOSERS, 0)
    squares: dict[str, list[np.ndarray]] = {name: [] for name in DIAGNOSERS}

    def note(recording: Recording) -> None:
        flying = recording.time >= 5.0
        for name in DIAGNOSERS:
            named[name] += round(recording.signals[f"{name}.faulty_rotor"][-1]) == rotor
            errors = np.column_stack((state_errors(recording, name), _velocity_error(recording, name)))
            squares[name].append((errors[flying] ** 2).mean(axis=0))

    scenario = nominal(faults=[fault])
    found = repeated(scenario, DIAGNOSERS, seeds, note)
    quiet = repeated(scenario.changed(sensor_noise=False), DIAGNOSERS, 1, lambda _: None)
    rows = []
    for name, a in found.items():
        rms = np.sqrt(np.mean(squares[name], axis=0)).tolist()
        rows.append(
            Row(
                *(name, rotor, loss, a.settling_time, quiet[name].settling_time),
                *(a.bias, a.std, float(a.spread.max()), a.ghost),
                *(named[name] / seeds, tuple(rms[:6]), rms[6]),
            )
        )
    return rows


def _velocity_error(recording: Recording, name: str) -> np.ndarray:
    true = recording.signals["plant.velocity"][:, 2]
    return recording.signals.get(f"{name}.vertical_velocity_estimate", np.full(len(true), np.nan)) - true


def time_varying(seeds: int) -> dict[str, float]:
    """Rms error of the loss of rotor 1 in scenario B from the onset on, by diagnoser."""
    base = load_scenario("ren_scenario_b")
    scenario = base.changed(components=base.plain()["components"] | TAU3, diagnosers=list(DIAGNOSERS))
    return {name: a.rms for name, a in repeated(scenario, DIAGNOSERS, seeds, lambda _: None).items()}


@dataclass(frozen=True)
class Disturbed:
    """Healthy flights under a constant disturbance, vz4: means over the flights, of all four rotors."""

    expected: tuple[float, ...]  #: B^-1 d
    raw: tuple[float, ...]  #: faults as they are estimated
    calibrated: tuple[float, ...]  #: losses beyond the healthy offset
    worst_raw: float  #: of all flights, |raw - expected|
    worst_calibrated: float


def disturbed(seeds: int) -> Disturbed:
    """Fly healthy under the paper's constant disturbance."""
    parameters = nominal().parameters | {"constant_disturbance": [0.0, 0.0, 0.0, *DISTURBANCE]}
    scenario = nominal(parameters=parameters, faults=[], diagnosers=["hinf"], components={})
    expected = np.linalg.solve(-flight_model(load_vehicle("ren_plus")).signatures, [0.0, *DISTURBANCE])
    raw, calibrated = [], []
    with System(scenario) as system:
        for seed in range(seeds):
            recording = fly(scenario.changed(seed=seed), system)
            after = recording.time >= 5.0
            raw.append(recording.signals["hinf.fault_estimate"][after].mean(axis=0))
            calibrated.append(losses(recording, "hinf")[after].mean(axis=0))
    return Disturbed(
        tuple(expected.tolist()),
        tuple(np.mean(raw, axis=0).tolist()),
        tuple(np.mean(calibrated, axis=0).tolist()),
        float(np.abs(np.array(raw) - expected).max()),
        float(np.abs(calibrated).max()),
    )


def tables(rows: Sequence[Row], varying: dict[str, float], constant: Disturbed, seeds: int) -> list[str]:
    """The figures in Markdown."""
    columns = ["diagnoser", "loss", "settling, ms", "without noise, ms", "bias", "spread", "largest spread", "ghosts"]
    columns += ["rotor named", "rms of angles, rad", "of rates, rad/s", "of v_z, m/s"]
    by_loss = []
    for name in DIAGNOSERS:
        four = name == "hinf"
        for loss in sorted({row.loss for row in rows}):
            part = [row for row in rows if (row.diagnoser, row.loss) == (name, loss)]
            by_loss.append(
                (
                    f"`{name}`",
                    f"{100 * loss:.0f} %",
                    f"{1000 * max(r.settling_time for r in part):.0f}",
                    f"{1000 * max(r.quiet_settling_time for r in part):.0f}",
                    f"{max(abs(r.bias) for r in part):.4f}",
                    f"{max(r.std for r in part):.4f}",
                    f"{max(r.largest_std for r in part):.4f}" if four else "",
                    f"{max(r.ghost for r in part):.4f}" if four else "",
                    f"{100 * min(r.named for r in part):.0f} %",
                    f"{max(max(r.state_rms[:3]) for r in part):.4f}",
                    f"{max(max(r.state_rms[3:]) for r in part):.4f}",
                    f"{max(r.velocity_rms for r in part):.4f}" if four else "",
                )
            )
    return [
        "# `hinf` and `fast_adaptive` on Ren's vehicle",
        "",
        f"A roll of 10 sin(0.2 t) degrees with sensor noise; {seeds} seeds for each rotor and loss. Each figure is "
        "that of the worst rotor. Settling: the mean of all flights stays within 5 % of the loss from then on (to the "
        "end where a tenth of the noise, which the mean still has, exceeds that); without noise: of one flight. "
        "Ghosts: largest mean estimate of a healthy rotor. `hinf_tau3` and `fast_adaptive` estimate torques: their "
        "losses are those of a rotor that fails alone.",
        "",
        *markdown_table(columns, by_loss),
        "",
        "Scenario B with the paper's disturbance and a wrong inertia, rms error of the loss of rotor 1: "
        + ", ".join(f"`{name}` {rms:.4f}" for name, rms in varying.items())
        + ".",
        "",
        "Constant disturbance of 0.5 rad/s2 about each axis, healthy, `hinf`, rotors 1 to 4:",
        "",
        f"- B⁻¹d: {_numbers(constant.expected)}",
        f"- raw estimate: {_numbers(constant.raw)} (worst flight off by {constant.worst_raw:.4f})",
        f"- beyond the healthy offset: {_numbers(constant.calibrated)} (worst flight {constant.worst_calibrated:.4f})",
    ]


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:+.4f}" for value in values)


def main() -> None:
    """Fly everything and write results/hinf.md and results/hinf.json."""
    begin = time.perf_counter()
    with processes(2) as pool:
        jobs = [pool.submit(proportional, rotor, loss, SEEDS) for loss in LOSSES for rotor in ROTORS]
        varying, constant = pool.submit(time_varying, SEEDS), pool.submit(disturbed, SEEDS)
        rows = [row for job in jobs for row in job.result()]
        lines = tables(rows, varying.result(), constant.result(), SEEDS)
        facts = {
            "proportional": [asdict(row) for row in rows],
            "time_varying_rms": varying.result(),
            "disturbed": asdict(constant.result()),
        }
    write_results("hinf", lines, facts)
    print(f"\n{SEEDS * (len(LOSSES) * len(ROTORS) + 2)} flights in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
