"""Figures of the reproduction of Nguyen, Hong (2018), beside what the paper's plots show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.reproduction import Figure, curves
from rotordx.orchestrator.reproduction.motor_offsets import (
    missing_thrust,
    offsets_if_alone,
    offsets_of_smallest_norm,
    torque_faults,
)

Array = NDArray[np.float64]

DIAGNOSERS = ("thau", "adaptive_thau", "asmto")
MOTORS = ("M1", "M2", "M3", "M4")
AXES = ("roll", "pitch", "yaw")


def figures(
    flown: Recording,
    quiet: Recording,
    varying: Recording,
    sign: Recording,
    layer: Recording,
    turned: Mapping[str, tuple[Array, Array]],
) -> Iterator[Figure]:
    """All figures.

    Args:
        flown, quiet: the experiment with noise and gusts, and without.
        varying: that with a time-varying fault.
        sign, layer: healthy flights with the two forms of the sliding term.
        turned: name -> (time, yaw torque taken for a fault) of the variants under a yaw disturbance.
    """
    yield _attitude(flown)
    yield _true_offsets(flown)
    yield _four_offsets(flown)
    yield _first_offset(flown, quiet)
    yield _torques(flown)
    yield _varying(varying)
    yield _sliding_gains(sign, layer)
    yield _yaw(turned)


def _attitude(flown: Recording) -> Figure:
    degrees = np.degrees(flown.signals["plant.euler"])
    return curves(
        "Attitude (figure 5)",
        "The paper shows the attitude of a hand-flown F450. Here it rolls to and fro by 5 degrees; the fault at 7 s "
        "pitches and yaws it for a moment.",
        "time (s)",
        "degrees",
        {name: (flown.time, degrees[:, i]) for i, name in enumerate(AXES)},
    )


def _true_offsets(flown: Recording) -> Figure:
    truth = missing_thrust(flown)
    return curves(
        "Motor offsets by the fault (figure 4)",
        "Thrust that each motor lacks: only motor 1 does, as in the paper. It is more than 30 % of hover, because the "
        "controller asks the failed motor for more.",
        "time (s)",
        "N",
        {name: (flown.time, truth[:, i]) for i, name in enumerate(MOTORS)},
    )


def _four_offsets(flown: Recording) -> Figure:
    named, smallest = flown.signals["asmto.motor_offset"], offsets_of_smallest_norm(flown, "asmto")
    return curves(
        "Fault estimation M1 to M4 (figure 6)",
        "The paper's plot has M2 to M4 disturbed by M1 until 18 s and zero afterwards. Solid: the verdict, which "
        "assumes one faulty motor, so that the others are zero throughout. Dashed: the smallest offsets that explain "
        "the torques; they never tell the motors apart.",
        "time (s)",
        "N",
        {name: (flown.time, named[:, i]) for i, name in enumerate(MOTORS)}
        | {f"{name}, smallest norm": (flown.time, smallest[:, i]) for i, name in enumerate(MOTORS)},
        dashed=tuple(f"{name}, smallest norm" for name in MOTORS),
    )


def _first_offset(flown: Recording, quiet: Recording) -> Figure:
    onset = flown.faults[0]["onset_s"]
    near = (flown.time > onset - 0.1) & (flown.time < onset + 0.4)
    time = flown.time[near]
    return curves(
        "Offset of motor 1 and its estimates (figure 7)",
        "The paper's estimate follows the real offset over tens of seconds. Here the first moments; the truth follows "
        "the lag of the motor.",
        "time (s)",
        "N",
        {"truth": (time, missing_thrust(flown)[near, 0])}
        | {name: (time, offsets_if_alone(flown, name)[near, 0]) for name in DIAGNOSERS}
        | {"asmto without noise": (time, offsets_if_alone(quiet, "asmto")[near, 0])},
        dashed=("truth",),
    )


def _torques(flown: Recording) -> Figure:
    estimated, torque = torque_faults(flown, "asmto")
    return curves(
        "Controller output offset and its estimate (figure 8)",
        "Torque that the fault takes away; the paper compares one curve and its estimate. The yaw torque is a "
        "fourteenth of the pitch torque.",
        "time (s)",
        "N.m",
        {f"{axis}, estimate": (flown.time, estimated[:, i]) for i, axis in enumerate(AXES)}
        | {f"{axis}, truth": (flown.time, torque[:, i]) for i, axis in enumerate(AXES)},
        dashed=tuple(f"{axis}, truth" for axis in AXES),
    )


def _varying(varying: Recording) -> Figure:
    return curves(
        "Time-varying fault of motor 1",
        "Claimed in the paper's abstract, not flown there: (20 + 10 sin 3t) % from 7 s on.",
        "time (s)",
        "N",
        {
            "asmto": (varying.time, offsets_if_alone(varying, "asmto")[:, 0]),
            "truth": (varying.time, missing_thrust(varying)[:, 0]),
        },
        dashed=("truth",),
    )


def _sliding_gains(sign: Recording, layer: Recording) -> Figure:
    return curves(
        "Sliding gain n in healthy flight",
        "Not in the paper. As printed, n grows faster and faster; with boundary layer, dead zone and leak it stays "
        "where noise leaves it.",
        "time (s)",
        "rad/s2",
        {
            "sign, as (14)": (sign.time, sign.signals["asmto.sliding_gain"]),
            "boundary layer, dead zone, leak": (layer.time, layer.signals["asmto.sliding_gain"]),
        },
    )


def _yaw(turned: Mapping[str, tuple[Array, Array]]) -> Figure:
    return curves(
        "Yaw torque taken for a fault under 2 sin 10t rad/s2",
        "Not in the paper, which claims robustness in words. Estimates that ignored the disturbance would be zero.",
        "time (s)",
        "N.m",
        {name: (time, error) for name, (time, error) in turned.items()},
    )
