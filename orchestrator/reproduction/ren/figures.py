"""Figures of the reproduction of Ren (2020), beside what the paper's plots show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.reproduction import Figure, curves
from rotordx.orchestrator.reproduction.ren.rotor_losses import losses, state_errors

#: name in a legend -> diagnoser
ESTIMATORS = {"vz4": "hinf", "tau3, rotor 1 alone": "hinf_tau3", "fast_adaptive, rotor 1 alone": "fast_adaptive"}
ROTORS = ("rotor 1", "rotor 2", "rotor 3", "rotor 4")
AXES = ("roll", "pitch", "yaw")


def figures(a: Recording, b: Recording, still: Recording) -> Iterator[Figure]:
    """All figures.

    Args:
        a, b: the two scenarios with noise, all estimators aboard.
        still: scenario A without fault and noise.
    """
    yield _fault(
        a,
        "Loss of rotor 1, proportional fault (figure 3)",
        "The paper's estimate steps to 0.3 at 40 s, that of [15] later and with overshoot. Here the first second, with "
        "motor lag and noise; losses beyond the mean of a healthy window, which holds the constant disturbance.",
        (39.9, 41.0),
    )
    yield _all_rotors(a)
    yield _attitude(a, "proportional fault (figure 4)", (38.0, 46.0))
    yield _fault(
        b,
        "Loss of rotor 1, time-varying fault (figure 5)",
        "The paper's estimate lies on the true one, that of [15] beside it. Here it does within the noise.",
        (5.0, 60.0),
    )
    yield _attitude(b, "time-varying fault (figure 6)", (5.0, 60.0))
    yield _errors(a)
    yield _disturbance(still)


def _within(recording: Recording, window: tuple[float, float]) -> NDArray[np.bool_]:
    return np.asarray((recording.time >= window[0]) & (recording.time <= window[1]))


def _fault(recording: Recording, title: str, caption: str, window: tuple[float, float]) -> Figure:
    part = _within(recording, window)
    time = recording.time[part]
    lines = {name: (time, losses(recording, diagnoser)[part, 0]) for name, diagnoser in ESTIMATORS.items()}
    truth = {"truth": (time, recording.signals["esc.loss_of_effectiveness"][part, 0])}
    return curves(title, caption, "time (s)", "loss of effectiveness", lines | truth, dashed=("truth",))


def _all_rotors(a: Recording) -> Figure:
    estimate = losses(a, "hinf")
    return curves(
        "Losses of all rotors, proportional fault",
        "Not in the paper, which shows rotor 1: four independent losses, of which three stay at zero.",
        "time (s)",
        "loss of effectiveness",
        {name: (a.time, estimate[:, i]) for i, name in enumerate(ROTORS)},
    )


def _attitude(recording: Recording, fault: str, window: tuple[float, float]) -> Figure:
    part = _within(recording, window)
    time = recording.time[part]
    lines = {}
    for i, axis in enumerate(AXES):
        lines[f"{axis}, vz4"] = (time, np.degrees(recording.signals["hinf.euler_estimate"][part, i]))
        lines[f"{axis}, truth"] = (time, np.degrees(recording.signals["plant.euler"][part, i]))
    return curves(
        f"Attitude and its estimate, {fault}",
        "The paper's estimates lie on the true angles before and after the fault; so do these.",
        "time (s)",
        "degrees",
        lines,
        dashed=tuple(f"{axis}, truth" for axis in AXES),
    )


def _errors(a: Recording) -> Figure:
    part = _within(a, (39.0, 43.0))
    lines = {
        f"{axis}, {name}": (a.time[part], state_errors(a, diagnoser)[part, i])
        for name, diagnoser in (("vz4", "hinf"), ("fast_adaptive", "fast_adaptive"))
        for i, axis in enumerate(("p", "q"), start=3)
    }
    return curves(
        "Errors of estimated body rates, proportional fault",
        "Not in the paper. The loss shows in the rates until it is estimated.",
        "time (s)",
        "rad/s",
        lines,
    )


def _disturbance(still: Recording) -> Figure:
    raw = still.signals["hinf.fault_estimate"]
    return curves(
        "What a constant disturbance looks like",
        "Not in the paper. Healthy flight under d, without noise: f_a over the squared hover speed, four rotors. What "
        "is judged is what comes on top of the mean from 2 to 5 s.",
        "time (s)",
        "fault over squared hover speed",
        {name: (still.time, raw[:, i]) for i, name in enumerate(ROTORS)},
    )
