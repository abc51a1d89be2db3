"""Reference trajectory of each diagnoser: a short flight with a loss in rotor 1, and what the diagnoser says to it.

`python -m rotordx.fmus.diagnosers.reference ID...` writes `ID/reference.csv` anew; a test replays the files through
the FMUs. Look at the difference before it is committed.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.model_terms.terms import allocation, input_gain, rate_dynamics
from rotordx.fmus.shell.ports import start_values, table
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import REFERENCE_VEHICLE, VehicleParameters

STEP_SIZE = 0.02  #: s, long, so that few rows reach past warm-up and calibration
DURATION = 8.0  #: s
ONSET = 6.0  #: s, after the warm-up and calibration of every diagnoser
LOSS = 0.2
SIGNIFICANT_DIGITS = 12


def reference_inputs() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Time (N,) and inputs (N, 11) of the reference flight.

    Attitude and rates are chosen, the commands follow from them by inverse rate dynamics; after the onset the
    command of rotor 1 is what its loss asks for.
    """
    vehicle = load_vehicle(REFERENCE_VEHICLE).fill(VehicleParameters)
    time = STEP_SIZE * np.arange(round(DURATION / STEP_SIZE), dtype=np.float64) + STEP_SIZE  # to the last bit the FMU's
    rate = 2 * np.pi * np.array([0.5, 0.4, 0.3])
    euler = np.array([0.1, 0.08, 0.2]) * np.sin(np.outer(time, rate))
    body_rate = np.array([0.1, 0.08, 0.2]) * rate * np.cos(np.outer(time, rate))
    acceleration = -np.array([0.1, 0.08, 0.2]) * rate**2 * np.sin(np.outer(time, rate))
    inputs = []
    for k in range(len(time)):
        zeta = ca.DM([0.0, *body_rate[k]])
        without_rotors = rate_dynamics(zeta, ca.DM(euler[k]), ca.DM.zeros(4), vehicle)
        effect = input_gain(ca.DM(euler[k]), vehicle) @ allocation(vehicle)
        wanted = ca.DM([0.0, *acceleration[k]]) - ca.DM(without_rotors)
        squared_speed = np.array(ca.solve(ca.DM(effect), wanted)).ravel()
        squared_speed[0] /= 1 - LOSS * (time[k] > ONSET)
        inputs.append([*np.sqrt(squared_speed), *euler[k], *body_rate[k], 0.0])
    return time, np.array([[float(_written(value)) for value in row] for row in inputs])  # what a replay reads


def reference_outputs(diagnoser: str, time: NDArray[np.float64], inputs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outputs (N, outputs) of a diagnoser with its start parameters, by its CasADi function."""
    step = diagnoser_function(diagnoser)
    parameters = [value for cls in diagnoser_component(diagnoser).parameters for value in start_values(cls)]
    state = start_function(diagnoser)()["x"]
    rows = []
    for t, u in zip(time, inputs, strict=True):
        state, outputs = step(state, u, t, [STEP_SIZE, *parameters])
        rows.append(np.array(outputs).ravel())
    return np.array(rows)


def columns(diagnoser: str) -> list[str]:
    """Header of a reference file: time, inputs, outputs by element."""
    ports = [*table(Inputs), *table(diagnoser_component(diagnoser).outputs)]
    return ["time", *(name for port in ports for name in port.element_names())]


def rows(diagnoser: str) -> Iterator[list[str]]:
    """Contents of a reference file below its header."""
    time, inputs = reference_inputs()
    outputs = reference_outputs(diagnoser, time, inputs)
    for row in np.column_stack((time, inputs, outputs)):
        yield [_written(value) for value in row]


def _written(value: float) -> str:
    return f"{value:.{SIGNIFICANT_DIGITS}g}"


def reference_file(diagnoser: str) -> Path:
    """Where the reference trajectory of a diagnoser lies."""
    return Path(str(files("rotordx.fmus.diagnosers") / diagnoser / "reference.csv"))


def main() -> None:
    """Write the reference files of the diagnosers that are named."""
    for diagnoser in sys.argv[1:]:
        with reference_file(diagnoser).open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns(diagnoser))
            writer.writerows(rows(diagnoser))


if __name__ == "__main__":
    main()
