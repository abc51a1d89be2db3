"""Recordings made by formulas that look like flights with `fdie`: what the report needs, without an FMU."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from rotordx.orchestrator.recording import Recording

STEP = 0.002
CHANNELS, ROTORS = 4, 4
BOUND = np.array([0.06, 0.16, 0.16, 0.012])  # settled detection thresholds of v_z, p, q, r
GAIN = np.array([5.0, 8.0, 8.0, 5.0])  # of the observers, 1/s
SIGNATURES = np.array([[2, -27, 27, -1.5], [2, 27, 27, 1.5], [2, 27, -27, -1.5], [2, -27, -27, 1.5]])
UNITS = {"rotor_speed": "rad/s", "rotor_speed_command": "rad/s", "position": "m", "position_reference": "m"}


def circle_flight(
    rotor: int | None = 1,
    loss: float = 0.2,
    onset: float = 24.0,
    duration: float = 60.0,
    seed: int = 1,
    diagnosers: tuple[str, ...] = ("fdie",),
    truth: bool = True,
) -> Recording:
    """A circle flown with one rotor weakened at the onset (none if `rotor` is None)."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration / STEP) + 1) * STEP
    since = (time - onset).clip(0)
    true_loss = np.zeros((len(time), ROTORS))
    faults = []
    if rotor is not None:
        true_loss[time >= onset, rotor - 1] = loss
        faults.append({"rotor": rotor, "onset_s": onset, "loss_of_effectiveness": loss, "profile": "abrupt"})

    reference = np.column_stack([np.cos(0.8 * time), np.sin(0.8 * time), np.full(len(time), -1.5)])
    sink = 0.3 * true_loss.sum(axis=1) * np.exp(-since / 0.9) * (1 - np.exp(-since / 0.25))
    wobble = np.column_stack([smooth(rng, time, 1.5, 0.012) for _ in range(3)])
    speed = 560 + np.column_stack([smooth(rng, time, 0.4, 4.0) for _ in range(ROTORS)])
    settled = 1 - np.exp(-since / 0.15)[:, np.newaxis]
    command = speed / np.sqrt(1 - true_loss * settled) + rng.normal(0, 2.5, speed.shape)
    signals = {
        "reference.position_reference": reference,
        "controller.rotor_speed_command": command,
        "esc.rotor_speed": filtered((command * np.sqrt(1 - true_loss)).T / 0.03, 1 / 0.03, start=command[0]).T,
        "plant.position": reference + wobble + np.outer(sink, [0.5, -0.4, 1.0]),
    }
    if truth:
        signals["esc.loss_of_effectiveness"] = true_loss
    for k, diagnoser in enumerate(diagnosers):
        said = diagnosis(time, rotor, loss, onset, np.random.default_rng(seed + 100 * k))
        signals |= {f"{diagnoser}.{port}": values for port, values in said.items()}
    return Recording(
        time=time,
        signals=signals,
        units={key: unit_of(key.split(".")[1]) for key in signals},
        descriptions={key: f"{key.split('.')[1]}: v_z, p, q, r" for key in signals},
        scenario={"name": "avram_circle", "vehicle": "lab_x", "seed": seed, "duration_s": duration, "faults": faults},
        faults=faults if truth else [],
        diagnosers=list(diagnosers),
        measurements={
            "wall_time_s": 0.09,
            "real_time_factor": duration / 0.09,
            "step_time_ns": dict.fromkeys(diagnosers, 212.0),
        },
    )


def diagnosis(time, rotor, loss, onset, rng) -> dict[str, np.ndarray]:
    """Outputs of a diagnoser that works as fdie does, by linear residuals."""
    uncertainty = np.array([smooth(rng, time, 0.8, 0.22 * GAIN[j] * BOUND[j]) for j in range(CHANNELS)])
    effect = loss * (time >= onset) * np.exp(-(time - onset).clip(0) / 3)
    forcing = uncertainty + (0 if rotor is None else np.outer(SIGNATURES[rotor - 1], effect))
    residual = np.array([filtered(forcing[j], GAIN[j]) for j in range(CHANNELS)]).T
    residual += rng.normal(0, 0.04 * BOUND, residual.shape)
    threshold = BOUND * (1 + 0.15 * np.sin(0.8 * time[:, np.newaxis] + np.arange(CHANNELS)) ** 2)
    detected = np.maximum.accumulate((np.abs(residual) > threshold).any(axis=1) & (time > 2))
    detection = time[np.argmax(detected)] if detected.any() else np.inf
    isolation = np.inf if rotor is None else detection + 0.114
    isolated = time >= isolation
    of_rotor = (np.arange(ROTORS) + 1 == rotor) * isolated[:, np.newaxis]
    bank = estimator_bank(time - detection, rotor, loss, uncertainty, forcing, rng)
    return {
        "fault_detected": detected.astype(float),
        "faulty_rotor": float(rotor or 0) * isolated,
        "loe_estimate": of_rotor * (loss + smooth(rng, time, 0.5, 0.0015))[:, np.newaxis],
        "detection_time": np.where(detected, detection, np.nan),
        "isolation_time": np.where(isolated, isolation, np.nan),
        "residual": residual,
        "threshold": threshold,
        **bank,
        "loe_lower": (of_rotor * bank["set_lower"]).sum(axis=1),
        "loe_upper": (of_rotor * bank["set_upper"]).sum(axis=1),
    }


def estimator_bank(since, rotor, loss, uncertainty, forcing, rng) -> dict[str, np.ndarray]:
    """Isolation estimators and sets of losses, `since` seconds after the detection."""
    running = since >= 0
    elapsed = since.clip(0, 1e9)
    residual, threshold = np.zeros((2, ROTORS * CHANNELS, len(since)))
    estimate, lower, upper = np.zeros((3, ROTORS, len(since)))
    for s in range(ROTORS):
        right = s + 1 == rotor
        estimate[s] = 0.5 * np.exp(-elapsed / 0.3) + right * loss * (1 - np.exp(-elapsed / 0.3))
        slack = 0.4 * (0.5 - np.abs(estimate[s] - 0.25))
        for j in range(CHANNELS):
            mismatch = uncertainty[j] if right else forcing[j] - estimate[s] * SIGNATURES[s, j]
            noise = rng.normal(0, 0.03 * BOUND[j], len(since))
            residual[CHANNELS * s + j] = (filtered(mismatch * running, GAIN[j]) + noise) * running
            bound = filtered((slack * np.abs(SIGNATURES[s, j]) + GAIN[j] * BOUND[j]) * running, GAIN[j])
            threshold[CHANNELS * s + j] = (bound + 0.3 * BOUND[j]) * running
        width = 0.5 * np.exp(-elapsed / 0.1) + 0.012
        centre = loss if right else -0.1 * (elapsed > 0.07 + 0.02 * s)
        lower[s], upper[s] = np.maximum(centre - width, 0), np.minimum(centre + width, 0.5)
    return {
        "isolation_residual": residual.T,
        "isolation_threshold": threshold.T,
        "set_lower": lower.T,
        "set_upper": upper.T,
        "fie_loe_estimate": estimate.T,
    }


def smooth(rng, time, correlation_time, std):
    """(N,) Gaussian noise with a correlation time (s) and a standard deviation."""
    noise = filtered(filtered(rng.normal(size=len(time)), 1 / correlation_time), 1 / correlation_time)
    return std * noise / noise.std()


def filtered(values, rate, start=None):
    """Response of x' = -rate x + values along the last axis, from 0 or from `start`."""
    decay = np.exp(-rate * STEP)
    numerator, denominator = [(1 - decay) / rate], [1, -decay]
    if start is None:
        return lfilter(numerator, denominator, values)
    return lfilter(numerator, denominator, values, zi=decay * start[:, np.newaxis])[0]


def unit_of(port: str) -> str:
    return "m/s, rad/s" if port.endswith(("residual", "threshold")) else UNITS.get(port, "1")
