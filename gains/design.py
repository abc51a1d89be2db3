"""Identified designs: parameters of a diagnoser for a vehicle, and the flights that they were identified from."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rotordx.fmus.shell.ports import table
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.fmus.vehicles.vehicle import Vehicle


@dataclasses.dataclass(frozen=True)
class Design:
    """Parameters by port name (SI; arrays are lists) and the evidence they rest on, as plain data."""

    diagnoser: str
    vehicle: str
    parameters: Mapping[str, float | list[float]]
    identified_from: Mapping[str, Any]


def write_design(design: Design, folder: Path) -> Path:
    """Write `<folder>/<vehicle>/<diagnoser>.json`; the same design gives the same bytes.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    path = folder / design.vehicle / f"{design.diagnoser}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(dataclasses.asdict(design), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return path


def vehicle_parameters(vehicle: Vehicle) -> dict[str, float | list[float]]:
    """The physical and sensor parameters that a design can rest on, as plain data."""
    values: dict[str, float | list[float]] = {}
    for cls in (VehicleParameters, SensorParameters):
        filled = vehicle.fill(cls)
        values |= {p.name: np.asarray(getattr(filled, p.name)).tolist() for p in table(cls)}
    return values


def vehicle_hash(vehicle: Vehicle) -> str:
    """SHA-256 (hexadecimal) of the parameters that a design rests on."""
    return plain_hash(vehicle_parameters(vehicle))


def plain_hash(values: Any) -> str:
    """SHA-256 (hexadecimal) of plain data, whatever the order of its keys."""
    return hashlib.sha256(json.dumps(values, sort_keys=True, allow_nan=False).encode()).hexdigest()
