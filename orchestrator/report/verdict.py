"""What a diagnoser made of a flight, in one sentence that does not hide bad news."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rotordx.orchestrator.metrics import faults_in, truth_known
from rotordx.orchestrator.recording import Recording


@dataclass(frozen=True)
class Verdict:
    """`good`: all that was promised; `fair`: nothing wrong, but not all; `bad`: missed, false or wrong; `open`: truth
    not known."""

    state: Literal["good", "fair", "bad", "open"]
    sentence: str


def verdict(recording: Recording, summary: dict[str, Any], diagnoser: str) -> Verdict:
    """Verdict on one diagnoser from its figures in the summary; the estimate's interval is read from the recording."""
    score = summary["diagnosers"][diagnoser]
    if not faults_in(recording):
        return _without_fault(recording, summary, score)
    what = fault_phrase(recording)
    if score["false_alarm"]:
        named = f", naming {rotor_phrase(score['faulty_rotor'])}" if score["faulty_rotor"] else ""
        return Verdict("bad", f"False alarm at {score['detection_time_s']:.2f} s{named}, before any fault. {what}.")
    if not score["fault_detected"]:
        peak = _peak(score, "Before it the residual peaked")
        return Verdict("bad", f"{what}: missed, no alarm until the end.{' ' + peak + '.' if peak else ''}")
    detected = f"detected after {delay_phrase(score['detection_delay_s'])}"
    rotor = score["faulty_rotor"]
    failed = {fault["rotor"] for fault in faults_in(recording)}
    if rotor == 0:
        return Verdict("fair", f"{what}: {detected}, no rotor named.")
    if rotor == -1:
        state: Literal["good", "bad"] = "good" if len(failed) > 1 else "bad"
        return Verdict(state, f"{what}: {detected}, declared unlike any loss of a single rotor.")
    after = delay_phrase(score["isolation_delay_s"])
    if rotor not in failed:
        return Verdict("bad", f"{what}: {detected}, but rotor {rotor} was wrongly named after {after}.")
    estimate = _estimate(recording, score, diagnoser)
    return Verdict(
        "good" if len(failed) == 1 else "fair",
        f"{what}: {detected}, isolated to rotor {rotor} after {after}{estimate}.",
    )


def fault_phrase(recording: Recording) -> str:
    """The injected or declared faults in words, e.g. "Rotor 1 lost 20 % of its thrust at 24.00 s"."""
    faults = faults_in(recording)
    first = faults[0]
    when = "from the start" if first["onset_s"] <= recording.time[0] else f"at {first['onset_s']:.2f} s"
    rotors = sorted({fault["rotor"] for fault in faults})
    if len(rotors) > 1:
        listed = ", ".join(map(str, rotors[:-1])) + f" and {rotors[-1]}"
        return f"Rotors {listed} lost thrust, the first {when}"
    if len(faults) > 1:
        return f"Rotor {rotors[0]} failed {len(faults)} times, first {when}"
    loss, profile = first.get("loss_of_effectiveness"), first.get("profile", "abrupt")
    if loss is None:
        return f"Rotor {rotors[0]} lost thrust {when}"
    if profile == "abrupt":
        return f"Rotor {rotors[0]} lost {percent(loss)} of its thrust {when}"
    return f"Rotor {rotors[0]} began to lose thrust {when} ({profile}, {percent(loss)})"


def percent(fraction: float) -> str:
    """Fraction as a percentage with as few digits as it needs: "20 %", "7.5 %"."""
    return f"{100 * fraction:.3g} %"


def delay_phrase(seconds: float | None) -> str:
    """Delay as "66 ms" below one second, else "1.36 s"."""
    if seconds is None:
        return "an unknown time"
    return f"{1000 * seconds:.0f} ms" if seconds < 1 else f"{seconds:.2f} s"


def rotor_phrase(rotor: int) -> str:
    """The value of `faulty_rotor` in words."""
    return {0: "no rotor", -1: "no single rotor"}.get(rotor, f"rotor {rotor}")


def isolation_phrase(recording: Recording, diagnoser: str) -> str:
    """How a diagnoser comes from faults to rotors, if it says so by its output `isolation_model`; else empty."""
    model = recording.signals.get(f"{diagnoser}.isolation_model")
    phrases = {1.0: "takes it that one rotor failed", 4.0: "four independent rotor losses"}
    return "" if model is None else phrases.get(float(model[-1]), "")


def _without_fault(recording: Recording, summary: dict[str, Any], score: dict[str, Any]) -> Verdict:
    healthy = truth_known(recording)
    if not score["fault_detected"]:
        peak = _peak(score, "peak residual")
        silence = f"{'No fault: no' if healthy else 'No'} alarm in {summary['duration_s']:.3g} s"
        return Verdict("good" if healthy else "open", f"{silence}{', ' + peak if peak else ''}.")
    when = "" if score["detection_time_s"] is None else f" at {score['detection_time_s']:.2f} s"
    rotor = score["faulty_rotor"]
    if rotor > 0:
        named = f"rotor {rotor} named at {score['isolation_time_s']:.2f} s"
    else:
        named = "no rotor named" if rotor == 0 else "unlike any loss of a single rotor"
    if healthy:
        return Verdict("bad", f"False alarm{when}: there was no fault; {named}.")
    estimate = score["loe_estimate"][rotor - 1] if rotor > 0 else None
    estimated = "" if estimate is None else f", its loss estimated at {estimate:.3f}"
    return Verdict("open", f"Alarm{when}: {named}{estimated}. What really happened is not known.")


def _peak(score: dict[str, Any], subject: str) -> str:
    peak = score["peak_residual_ratio_before_fault"]
    return "" if peak is None else f"{subject} at {peak:.2f} of its threshold"


def _estimate(recording: Recording, score: dict[str, Any], diagnoser: str) -> str:
    value = score["loe_estimate"][score["faulty_rotor"] - 1]
    if value is None:
        return ""
    lower, upper = (recording.signals.get(f"{diagnoser}.{port}") for port in ("loe_lower", "loe_upper"))
    if lower is None or upper is None or not np.isfinite(upper[-1] - lower[-1]):
        return f", estimated at {value:.3f}"
    return f", estimated at {value:.3f} ± {max(upper[-1] - value, value - lower[-1]):.3f}"
