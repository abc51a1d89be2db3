"""Short recordings whose figures one can work out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from rotordx.orchestrator.recording import Recording

STEP = 0.1
FAULT = {"rotor": 2, "onset_s": 4.0, "loss_of_effectiveness": 0.3, "profile": "abrupt"}


def recording(
    *,
    detection: float | None = 4.5,
    isolation: float | None = 5.0,
    rotor: int = 2,
    estimate: float = 0.28,
    faults: tuple[dict[str, Any], ...] = (FAULT,),
    truth: bool = True,
    peak: float = 0.5,
    **changes: Any,
) -> Recording:
    """10 s at 10 Hz in which a diagnoser `d` detects and isolates when told.

    Its one threshold is 2, its residual 1e3 at 0 s (where the threshold is still 0), -2 `peak` at 3 s, 6 from 4 s on.
    `changes` replace ports of `d`, None removes one.
    """
    time = np.arange(101) * STEP
    named = time >= (np.inf if isolation is None else isolation - 1e-9)
    residual = np.where(time >= 4 - 1e-9, 6.0, 0.1)
    residual[[0, 30]] = 1e3, -2 * peak
    loe = np.zeros((101, 4))
    if rotor > 0:
        loe[named, rotor - 1] = estimate
    ports: dict[str, Any] = {
        "fault_detected": (time >= (np.inf if detection is None else detection - 1e-9)).astype(float),
        "detection_time": time_from(time, detection),
        "faulty_rotor": np.where(named, float(rotor), 0.0),
        "isolation_time": time_from(time, isolation),
        "loe_estimate": loe,
        "residual": residual[:, np.newaxis],
        "threshold": np.where(time > 0, 2.0, 0.0)[:, np.newaxis],
    } | changes
    signals = {f"d.{port}": values for port, values in ports.items() if values is not None}
    if truth:
        signals["esc.loss_of_effectiveness"] = true_loss(time, faults)
    return Recording(
        time=time,
        signals=signals,
        units=dict.fromkeys(signals, "1"),
        descriptions=dict.fromkeys(signals, "hand made"),
        scenario={"name": "by hand", "vehicle": "lab_x", "seed": 7},
        faults=list(faults),
        diagnosers=["d"],
        measurements={"wall_time_s": 0.5, "real_time_factor": 20.0, "step_time_ns": {"d": 250.0}},
    )


def time_from(time: np.ndarray, event: float | None) -> np.ndarray:
    """NaN before an event, its time from then on."""
    return np.full(len(time), np.nan) if event is None else np.where(time >= event - 1e-9, event, np.nan)


def true_loss(time: np.ndarray, faults: tuple[dict[str, Any], ...]) -> np.ndarray:
    loss = np.zeros((len(time), 4))
    for fault in faults:
        loss[time >= fault["onset_s"] - 1e-9, fault["rotor"] - 1] = fault["loss_of_effectiveness"]
    return loss
