"""Thrust that rotors lack, as it is and as torque faults tell: what the Thau observers are judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from rotordx.fmus.model_terms.allocation import allocation_rows
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System

Array = NDArray[np.float64]

#: an estimate has settled when it stays within so much of the final offset
SETTLED = 0.05

#: s after the onset in which it has to settle, and from when on bias and spread count
ONSET_WINDOW, STEADY_AFTER = 0.5, 2.0


def vehicle_of(recording: Recording) -> VehicleParameters:
    """The vehicle as controller and diagnosers of a flight know it."""
    vehicle = load_vehicle(recording.scenario["vehicle"]).fill(VehicleParameters)
    changed = {name: np.array(recording.scenario["parameters"][name]) for name in _changed(recording)}
    return VehicleParameters(**{**vars(vehicle), **changed})


def _changed(recording: Recording) -> set[str]:
    return set(recording.scenario["parameters"]) & set(VehicleParameters.__dataclass_fields__)


def healthy_thrust(recording: Recording) -> Array:
    """Thrust of healthy rotors (N, 4) that obey the commands, N."""
    vehicle = vehicle_of(recording)
    command = recording.signals["controller.rotor_speed_command"]
    command = np.clip(command, vehicle.rotor_speed_min, vehicle.rotor_speed_max)
    decay = np.exp(-recording.time[1] / vehicle.motor_time_constant)
    speed = lfilter([1 - decay], [1, -decay], command, axis=0, zi=decay * command[:1])[0]
    return np.asarray(vehicle.thrust_coefficient * speed**2)


def missing_thrust(recording: Recording) -> Array:
    """Thrust of each rotor (N, 4) beyond that of a healthy one with the same command, N: negative for a loss."""
    thrust = vehicle_of(recording).thrust_coefficient * recording.signals["esc.rotor_speed"] ** 2
    return np.asarray(thrust - healthy_thrust(recording))


def torque_of_thrust(vehicle: VehicleParameters) -> Array:
    """Torque (3, 4) about x, y, z per thrust of each rotor, m."""
    rows = np.array(allocation_rows(vehicle), dtype=float)
    return rows[1:] / rows[0]


def offsets_if_alone(recording: Recording, diagnoser: str) -> Array:
    """Thrust (N, 4), N, that each rotor lacks if it alone is faulty: least squares, weighted as the diagnoser does."""
    vehicle = vehicle_of(recording)
    margin = recording.signals[f"{diagnoser}.threshold"][-1, -3:]
    effect = torque_of_thrust(vehicle) / np.asarray(vehicle.inertia)[:, None] / margin[:, None]
    deviation = recording.signals[f"{diagnoser}.residual"][:, -3:] / margin
    return np.asarray(deviation @ effect / (effect**2).sum(axis=0))


def offsets_of_smallest_norm(recording: Recording, diagnoser: str) -> Array:
    """Thrust (N, 4), N, by the pseudo-inverse: of all that explain the torques, the smallest."""
    torque, _ = torque_faults(recording, diagnoser)
    return np.asarray(torque @ np.linalg.pinv(torque_of_thrust(vehicle_of(recording))).T)


def torque_faults(recording: Recording, diagnoser: str) -> tuple[Array, Array]:
    """Estimated and true torques (N, 3) about x, y, z beyond the healthy rotors', N.m."""
    vehicle = vehicle_of(recording)
    estimated = recording.signals[f"{diagnoser}.residual"][:, -3:] * np.asarray(vehicle.inertia)
    return np.asarray(estimated), np.asarray(missing_thrust(recording) @ torque_of_thrust(vehicle).T)


@dataclass(frozen=True)
class Accuracy:
    """How well the offset of the rotor that fails first is estimated in one flight."""

    settling_time: float  #: s after the onset, from when on the estimate stays within 5 % of the offset
    bias: float  #: relative to the offset
    std: float  #: N
    offset: float  #: N, mean in the steady state


def accuracy(recording: Recording, diagnoser: str) -> Accuracy:
    """Of the estimate for the rotor that fails first, as if it alone failed."""
    rotor, onset = recording.faults[0]["rotor"] - 1, recording.faults[0]["onset_s"]
    truth = missing_thrust(recording)[:, rotor]
    error = offsets_if_alone(recording, diagnoser)[:, rotor] - truth
    steady = recording.time >= onset + STEADY_AFTER
    offset = float(truth[steady].mean())
    begins = (recording.time > onset) & (recording.time <= onset + ONSET_WINDOW)
    off = recording.time[begins][np.abs(error[begins]) > SETTLED * abs(offset)]
    settling_time = float(off[-1] - onset) if len(off) else 0.0
    return Accuracy(settling_time, float(error[steady].mean()) / offset, float(error[steady].std()), offset)


@dataclass(frozen=True)
class Repetitions:
    """Figures of noisy repetitions of one experiment with one diagnoser."""

    settling_time: Array  #: s
    bias: Array  #: relative
    std: Array  #: N
    detection_delay: Array  #: s, infinite if there was no detection
    named: Array  #: rotor

    def text(self) -> str:
        """The worst of all."""
        return (
            f"within 5 % after {1000 * self.settling_time.max():.0f} ms, bias {100 * np.abs(self.bias).max():.2f} %, "
            f"spread {self.std.max():.3f} N (worst of {len(self.bias)})"
        )


def repeated(scenario: Scenario, seeds: int, flown: Callable[[], None]) -> dict[str, Repetitions]:
    """Fly an experiment with several seeds; diagnoser -> its figures.

    Args:
        flown: called after every flight.
    """
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in scenario.diagnosers}
    with System(scenario) as system:
        for seed in range(seeds):
            recording = fly(scenario.changed(seed=seed), system)
            verdicts = summarise(recording)["diagnosers"]
            for name, found in rows.items():
                a, verdict = accuracy(recording, name), verdicts[name]
                delay = verdict["detection_delay_s"]
                missed = float("inf") if delay is None else delay
                found.append((a.settling_time, a.bias, a.std, missed, verdict["faulty_rotor"]))
            flown()
    return {name: Repetitions(*np.array(found, dtype=float).T) for name, found in rows.items()}
