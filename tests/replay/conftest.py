"""A small flight log in axes and units that differ from ours in every way, and its mapping."""

from __future__ import annotations

import copy
import csv
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains.flights import Flight
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.healthy_flights import flight_of
from rotordx.orchestrator.identification import identify
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import load_scenario

MAPPING: dict[str, Any] = {
    "time": {"column": "t_ms", "unit": "ms"},
    "rotor_speed_command": {"kind": "rotor_speed", "columns": ["m1", "m2", "m3", "m4"], "unit": "rpm"},
    "body_rate": {"columns": ["gx", "gy", "gz"], "sign": [1, -1, -1], "unit": "deg/s"},
    "euler": {"source": "columns", "columns": ["roll", "pitch", "yaw"], "sign": [1, -1, -1], "unit": "deg"},
    "vertical_velocity": {"velocity": {"column": "climb", "unit": "cm/s", "sign": -1, "filtered": True}},
}


def toml(document: dict[str, Any]) -> str:
    """Minimal TOML of nested tables: JSON's scalars and lists are TOML's too."""
    text = "".join(f"{key} = {json.dumps(value)}\n" for key, value in document.items() if not isinstance(value, dict))
    for key, table in document.items():
        if isinstance(table, dict):
            entries = [f"{json.dumps(k)} = {inline(v)}" for k, v in table.items()]
            text += f"[{key}]\n" + "\n".join(entries) + "\n"
    return text


def inline(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {inline(v)}" for k, v in value.items()) + "}"
    return json.dumps(value)


@pytest.fixture
def mapping() -> dict[str, Any]:
    """The mapping as plain data, to be changed by a test."""
    return copy.deepcopy(MAPPING)


@pytest.fixture
def write_map(tmp_path: Path):
    """Function that writes a mapping and returns its path."""

    def write(document: dict[str, Any], name: str = "foreign.toml") -> Path:
        path = tmp_path / name
        path.write_text(toml(document), encoding="utf-8")
        return path

    return write


@pytest.fixture
def write_csv(tmp_path: Path):
    """Function that writes columns as CSV and returns the path."""

    def write(columns: dict[str, Any], name: str = "flight.csv") -> Path:
        path = tmp_path / name
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(columns)
            writer.writerows(zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True))
        return path

    return write


def foreign_log(time: np.ndarray, **signals: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of MAPPING from SI signals (NED, FRD): rotor_speed_command, body_rate, euler, vertical_velocity."""
    zeros = np.zeros((len(time), 4))
    command = signals.get("rotor_speed_command", zeros + 500) * 30 / np.pi
    rate = np.degrees(signals.get("body_rate", zeros[:, :3]))
    euler = np.degrees(signals.get("euler", zeros[:, :3]))
    climb = -100 * signals.get("vertical_velocity", zeros[:, 0])
    return {
        "t_ms": 1000 * time,
        **{f"m{i + 1}": command[:, i] for i in range(4)},
        "gx": rate[:, 0],
        "gy": -rate[:, 1],
        "gz": -rate[:, 2],
        "roll": euler[:, 0],
        "pitch": -euler[:, 1],
        "yaw": -euler[:, 2],
        "climb": climb,
    }


def foreign_log_of(recording: Recording) -> dict[str, np.ndarray]:
    """Columns of MAPPING from what the diagnosers of a simulated flight were fed.

    A row of a recording holds the command of the step that ends there; a log stamps it when it is sent.
    """
    signals = recording.signals
    command = signals["controller.rotor_speed_command"]
    return foreign_log(
        recording.time,
        rotor_speed_command=np.vstack((command[1:], command[-1:])),
        body_rate=signals["sensors.body_rate"],
        euler=signals["sensors.euler"],
        vertical_velocity=signals["sensors.vertical_velocity"],
    )


def cut(flight: Flight, start: float, stop: float = np.inf) -> Flight:
    """The part of a flight between two times (s)."""
    inside = (flight.time >= start) & (flight.time <= stop)
    arrays = {field: values[inside] for field, values in vars(flight).items() if field != "name"}
    return dataclasses.replace(flight, **arrays)


@pytest.fixture(scope="session")
def craft(tmp_path_factory) -> Path:
    """Vehicle file and designs of a lab_x, identified from two healthy simulated flights."""
    out = tmp_path_factory.mktemp("craft") / "craft.toml"
    recordings = [fly(load_scenario("healthy_circle", seed=seed, duration_s=15.0)) for seed in (11, 12)]
    identify([flight_of(r, "circle") for r in recordings], load_vehicle("lab_x"), out)
    return out


@pytest.fixture(scope="session")
def broken_rotor(craft) -> Recording:
    """Simulated flight of that craft, in which rotor 3 loses 20 % of its thrust after 6 s."""
    fault = {"rotor": 3, "onset_s": 6.0, "loss_of_effectiveness": 0.2}
    return fly(load_scenario("avram_circle", seed=13, duration_s=9.0, vehicle=str(craft), faults=[fault]))
