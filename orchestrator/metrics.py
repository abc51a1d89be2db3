"""Scores of the diagnosers of a recording: the figures of summary.json, and what each of them means."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.errors import RunError
from rotordx.orchestrator.recording import Recording

TRUTH = "esc.loss_of_effectiveness"
FINAL_PERIOD = 3.0  #: s at the end of a recording over which the final estimate is averaged

#: outputs of a diagnoser that are scored, and their sizes; the first one it must have
VERDICT = {"fault_detected": 1, "faulty_rotor": 1, "loe_estimate": 4, "detection_time": 1, "isolation_time": 1}

#: every figure of a diagnoser in the order of summary.json, and its meaning
MEANING = {
    "fault_detected": "An alarm was raised at some time.",
    "detection_time_s": "Time of the first alarm.",
    "detection_delay_s": "From the first fault's onset to the first alarm; none after a false alarm.",
    "false_alarm": "The first alarm came before any fault; unknown where the truth is.",
    "faulty_rotor": "Rotor named at the end: 0 none, -1 the fault is no loss of a single rotor.",
    "isolation_time_s": "Time at which a rotor was named.",
    "isolation_delay_s": "From the first fault's onset to that verdict; none if it came before the onset.",
    "isolation_correct": "After the onset the one failed rotor was named; open unless exactly one rotor failed.",
    "loe_estimate": "Loss of effectiveness of each rotor, estimated at the end.",
    "loe_rmse": "Root mean square of |estimate - truth| over the four rotors together, from the isolation on.",
    "loe_final_error": "Mean of estimate - truth over the last 3 s, of the failed rotor where it is largest.",
    "peak_residual_ratio_before_fault": "Largest |residual| / threshold before any fault; above 1 is an alarm.",
    "step_time_ns": "Computing time of one step of the diagnoser.",
}


def summarise(recording: Recording) -> dict[str, Any]:
    """The contents of summary.json: plain JSON data in which whatever was not reached or is not known is None."""
    scenario = recording.scenario
    duration, step_size = _duration_and_step(recording)
    return {
        "scenario": scenario.get("name"),
        "vehicle": scenario.get("vehicle"),
        "seed": scenario.get("seed"),
        "step_size_s": step_size,
        "duration_s": duration,
        "steps": round(duration / step_size) if step_size else 0,
        "wall_time_s": _number(recording.measurements.get("wall_time_s")),
        "real_time_factor": _number(recording.measurements.get("real_time_factor")),
        "faults": [
            {key: fault.get(key) for key in ("rotor", "onset_s", "loss_of_effectiveness", "profile")}
            for fault in recording.faults
        ],
        "diagnosers": {diagnoser: score(recording, diagnoser) for diagnoser in recording.diagnosers},
    }


def score(recording: Recording, diagnoser: str) -> dict[str, Any]:
    """Figures of one diagnoser, each explained in `MEANING`.

    A detection that precedes every onset is a false alarm: it has a time but no delay, so that delays average what
    was really detected. `isolation_correct` is None unless exactly one rotor failed; then it is True if that rotor
    was named after the onset and still is at the end, else False, also if none was ever named. A diagnoser without
    outputs for the instants has them from the signals: the first alarm, and since when the rotor named at the end was.

    Raises:
        RunError: at the end it names something that is no rotor.
    """
    known = truth_known(recording)
    onset = first_onset(recording)
    failed = sorted({int(fault["rotor"]) for fault in faults_in(recording)})
    detected = _signal(recording, diagnoser, "fault_detected")
    rotors = _finite(_signal(recording, diagnoser, "faulty_rotor"))
    if rotors.size and rotors[-1] not in (-1, 0, 1, 2, 3, 4):
        raise RunError(
            f"{diagnoser}.faulty_rotor is {rotors[-1]:g} at the end but must be a rotor from 1 to 4, 0 for none or -1 "
            "for no loss of a single rotor: map it with scale and offset"
        )
    detection_times, isolation_times = _instants(recording, diagnoser)

    fault_detected = detected is not None and bool(np.any(detected > 0.5))
    detection_time = float(detection_times[0]) if fault_detected and detection_times.size else None
    isolation_time = float(isolation_times[-1]) if isolation_times.size else None
    faulty_rotor = int(rotors[-1]) if rotors.size else 0
    detection_delay, isolation_delay = _delay(detection_time, onset), _delay(isolation_time, onset)
    false_alarm = fault_detected and (onset is None or (detection_time is not None and detection_time < onset))
    estimate = _signal(recording, diagnoser, "loe_estimate")
    rmse, final_error = _estimation_errors(recording, estimate, isolation_time, failed)
    return {
        "fault_detected": fault_detected,
        "detection_time_s": detection_time,
        "detection_delay_s": detection_delay,
        "false_alarm": false_alarm if known else None,
        "faulty_rotor": faulty_rotor,
        "isolation_time_s": isolation_time,
        "isolation_delay_s": isolation_delay,
        "isolation_correct": faulty_rotor == failed[0] and isolation_delay is not None if len(failed) == 1 else None,
        "loe_estimate": [None] * 4 if estimate is None else [_number(value) for value in estimate[-1]],
        "loe_rmse": rmse,
        "loe_final_error": final_error,
        "peak_residual_ratio_before_fault": (
            _peak_residual_ratio(recording, diagnoser, onset) if known or not fault_detected else None
        ),
        "step_time_ns": _number((recording.measurements.get("step_time_ns") or {}).get(diagnoser)),
    }


def _instants(recording: Recording, diagnoser: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Instants (s) of detection and of isolation, the first and the last of which count."""
    detection, isolation = (_signal(recording, diagnoser, f"{event}_time") for event in ("detection", "isolation"))
    detected, rotor = (_signal(recording, diagnoser, port) for port in ("fault_detected", "faulty_rotor"))
    if detection is None and detected is not None:
        detection = recording.time[detected > 0.5]
    if isolation is None and rotor is not None:
        named = np.isfinite(rotor) & (rotor > 0)
        changes = np.diff(np.where(named, rotor, 0.0), prepend=0.0)
        isolation = recording.time[named & (changes != 0)]
    return _finite(detection), _finite(isolation)


def faults_in(recording: Recording) -> list[dict[str, Any]]:
    """Faults that take effect before the recording ends, in the order of their onsets."""
    end = recording.time[-1] if len(recording.time) else -math.inf
    faults = [
        fault
        for fault in recording.faults
        if fault["onset_s"] < end and (fault.get("loss_of_effectiveness") != 0 or fault.get("profile") == "function")
    ]
    return sorted(faults, key=lambda fault: fault["onset_s"])


def first_onset(recording: Recording) -> float | None:
    """Onset (s) of the first fault in the recording, None without one."""
    return min((float(fault["onset_s"]) for fault in faults_in(recording)), default=None)


def truth_known(recording: Recording) -> bool:
    """Whether it is known which rotors were healthy: so in a simulation, and in a replay with declared faults."""
    return TRUTH in recording.signals or bool(recording.faults)


def true_loss(recording: Recording) -> NDArray[np.float64] | None:
    """(N, 4) loss of effectiveness that really acted: as simulated, else as declared for a replay; None if unknown."""
    if TRUTH in recording.signals:
        return recording.signals[TRUTH]
    if not recording.faults or any(
        fault.get("profile", "abrupt") != "abrupt" or fault.get("loss_of_effectiveness") is None
        for fault in recording.faults
    ):
        return None
    effectiveness = np.ones((len(recording.time), 4))
    for fault in recording.faults:
        effectiveness[recording.time >= fault["onset_s"], int(fault["rotor"]) - 1] *= 1 - fault["loss_of_effectiveness"]
    return 1 - effectiveness


def residual_ratio(recording: Recording, diagnoser: str) -> NDArray[np.float64] | None:
    """(N,) largest |residual| / threshold over the residuals, NaN while no threshold is positive (warm-up)."""
    residual, threshold = (_signal(recording, diagnoser, port) for port in ("residual", "threshold"))
    if residual is None or threshold is None:
        return None
    valid = (threshold > 0) & np.isfinite(residual)
    ratio = np.divide(np.abs(residual), threshold, out=np.full(residual.shape, np.nan), where=valid)
    return np.fmax.reduce(ratio.reshape(len(ratio), -1), axis=1)


def _duration_and_step(recording: Recording) -> tuple[float, float | None]:
    """(duration, step size) in s: as set, also if not every step was logged; else what the samples say."""
    samples = recording.time
    duration = recording.scenario.get("duration_s", float(samples[-1] - samples[0]) if len(samples) else 0.0)
    measured = round(duration / (len(samples) - 1), 12) if len(samples) > 1 else None
    return duration, recording.scenario.get("step_size_s", measured)


def _peak_residual_ratio(recording: Recording, diagnoser: str, onset: float | None) -> float | None:
    ratio = residual_ratio(recording, diagnoser)
    if ratio is None:
        return None
    before = _finite(ratio if onset is None else ratio[recording.time < onset])
    return float(before.max()) if before.size else None


def _estimation_errors(
    recording: Recording, estimate: NDArray[np.float64] | None, isolation_time: float | None, failed: list[int]
) -> tuple[float | None, float | None]:
    """(loe_rmse, loe_final_error); None before an isolation, without an estimate and where the truth is not known."""
    truth = true_loss(recording)
    if truth is None or estimate is None or isolation_time is None:
        return None, None
    time = recording.time
    error = estimate - truth
    isolated = (time >= isolation_time) & np.isfinite(error).all(axis=1)
    final = isolated & (time >= time[-1] - FINAL_PERIOD)
    rmse = math.sqrt(np.mean(np.sum(error[isolated] ** 2, axis=1))) if isolated.any() else None
    if not final.any() or not failed:
        return rmse, None
    of_failed = error[final].mean(axis=0)[[rotor - 1 for rotor in failed]]
    return rmse, float(of_failed[np.argmax(np.abs(of_failed))])


def _signal(recording: Recording, diagnoser: str, port: str) -> NDArray[np.float64] | None:
    values = recording.signals.get(f"{diagnoser}.{port}")
    return values if values is not None and len(values) else None


def _finite(values: NDArray[np.float64] | None) -> NDArray[np.float64]:
    return np.empty(0) if values is None else values[np.isfinite(values)]


def _delay(time: float | None, onset: float | None) -> float | None:
    """Time since the onset without the rounding error of the subtraction, None if negative."""
    return None if time is None or onset is None or time < onset else round(time - onset, 9)


def _number(value: Any) -> float | None:
    """JSON number, None for what is missing or not finite."""
    return float(value) if value is not None and math.isfinite(value) else None
