"""Design files of either kind, and designs that are identified: parameters, and the flights that they come from."""

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
    """Write the file of an identified design; the same design gives the same bytes.

    Raises:
        OSError: it cannot be written.
    """
    text = json.dumps(dataclasses.asdict(design), indent=1, allow_nan=False) + "\n"
    return write_whole(design_file(folder, design.vehicle, design.diagnoser), text)


def design_file(folder: Path, vehicle: str, diagnoser: str) -> Path:
    """Where a folder of designs has that of a diagnoser for a vehicle: `<folder>/<vehicle>/<diagnoser>.json`."""
    return folder / vehicle / f"{diagnoser}.json"


def write_whole(path: Path, text: str) -> Path:
    """Write a file, whole or not at all, and the folders that it lies in.

    Raises:
        OSError: it cannot be written; `filename` is the path.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        partial.write_text(text, encoding="utf-8")
        return partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


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
