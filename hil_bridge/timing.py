"""The timing report of a flight over a bus: what summary.json holds under "hil", and how it is said."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.hil_bridge.load import measured_load
from rotordx.hil_bridge.settings import OWN, REAL, RUNNING, BridgeSettings
from rotordx.hil_bridge.ticker import Ticker
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario

MODES = {
    OWN: "emulated, rotor speeds return every tick",
    RUNNING: "emulated by another program, rotor speeds return every tick",
    REAL: "real, rotor speeds of Status are held between updates",
}


def figures(
    recording: Recording, scenario: Scenario, settings: BridgeSettings, ticker: Ticker, granted: dict[str, bool]
) -> dict[str, Any]:
    """Plain data about a flight over a bus; times in s, loads as shares of the bit rate."""
    ticks = len(recording.time) - 1
    rows, escs, link = slice(1, ticks + 1), ticker.escs, ticker.link
    planned, frames = settings.plan(scenario), link.frames
    duration = max(ticks, 1) * scenario.step_size_s
    impairment = settings.bus.impairment
    return {
        "verdict": ticker.verdict or ("degraded" if ticker.degraded_at is not None else "complete"),
        "mode": "lock step" if settings.lockstep else "real time",
        "escs": MODES[settings.escs],
        "bus": str(settings.bus),
        "impairment": None if impairment is None else {k: v for k, v in asdict(impairment).items() if v < np.inf},
        "ticks": ticks,
        "held_ticks": ticker.held,
        "degraded_from_s": ticker.degraded_at,
        "lateness_s": None if settings.lockstep else quantiles(ticker.lateness),
        "missed_ticks": None if settings.lockstep else int(np.sum(ticker.lateness >= scenario.step_size_s)),
        "command_to_telemetry_s": quantiles(ticker.answer_age[rows]),
        "status_age_s": quantiles(ticker.status_age[rows]),
        "frames": {
            "lost_answers": escs.lost["RotorSpeeds"],
            "late_answers": escs.late,
            "lost_commands": escs.lost["command"],
            "lost_status": escs.lost["Status"],
            "stale": link.stale,
            "broken": link.broken,
            "foreign": link.foreign,
        },
        "bus_load": {
            "bit_rate": settings.bit_rate,
            "planned": planned.load(),
            "planned_without_stuff_bits": planned.load(stuffed=False),
            "measured": measured_load(frames, duration, settings.bit_rate, stuffed=True),
            "measured_without_stuff_bits": measured_load(frames, duration, settings.bit_rate, stuffed=False),
        },
        "machine": {**granted, "spin_margin_s": settings.spin_margin, "load_average": ticker.host_load},
    }


def quantiles(values: NDArray[np.float64]) -> dict[str, float] | None:
    """p50, p99, p99.9 and the largest of what is finite; None without any."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return None
    p50, p99, p999 = np.quantile(finite, (0.5, 0.99, 0.999))
    return {"p50": float(p50), "p99": float(p99), "p99.9": float(p999), "max": float(finite.max())}


def sentences(hil: dict[str, Any]) -> list[str]:
    """The report in a few lines."""
    load, frames, late = hil["bus_load"], hil["frames"], hil["lateness_s"]
    lines = [f"bus {hil['bus']}, {hil['mode']}, ESCs {hil['escs']}: {hil['verdict']}"]
    if late is not None:
        lines.append(
            f"lateness p50 {_ms(late['p50'])}, p99 {_ms(late['p99'])}, p99.9 {_ms(late['p99.9'])} ms; "
            f"{hil['missed_ticks']} of {hil['ticks']} ticks missed"
        )
    age = hil["command_to_telemetry_s"]
    if age is not None:
        lines.append(f"command to telemetry p50 {_ms(age['p50'])}, p99 {_ms(age['p99'])} ms")
    lines.append(
        "frames: "
        + ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in frames.items())
        + f"; {hil['held_ticks']} ticks without a fresh answer"
    )
    lines.append(
        f"bus load {100 * load['measured']:.1f} % measured, {100 * load['planned']:.1f} % planned "
        f"(without stuff bits {100 * load['measured_without_stuff_bits']:.1f} and "
        f"{100 * load['planned_without_stuff_bits']:.1f} %) of {load['bit_rate'] / 1e3:g} kbit/s"
    )
    return lines


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3f}"
