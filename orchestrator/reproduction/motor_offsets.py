"""Thrust that rotors lack in a flight, as it is and as a diagnoser's torque faults tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from rotordx.fmus.model_terms.allocation import allocation_rows
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.orchestrator.recording import Recording

Array = NDArray[np.float64]


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
