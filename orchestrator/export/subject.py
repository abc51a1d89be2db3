"""What is exported: a diagnoser with the parameters that its FMU is given for a vehicle, and a flight that it answers.

The flight's inputs are float32 numbers every `ROW_STEPS` steps, held to be linear in between, so that they are the
same bit for bit in both precisions and small enough for a microcontroller. What is right, the FMU says.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus import diagnoser_ids, load_component
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.shell.ports import STEP_SIZE, Component, size, table, with_starts
from rotordx.fmus.vehicles import Vehicle, VehicleError, load_design, load_vehicle
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.layout import load_layout
from rotordx.orchestrator.parameters import missing_design, parameter_values
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.replay import SYSTEM as REPLAY
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from rotordx.orchestrator.wiring import EXTERNAL

ROTOR, ONSET, LOSS, DURATION = 1, 8.0, 0.2, 10.0  #: of the test flight: rotor, s, fraction, s
ROW_STEPS = 20
SHORTEST_STEP, LONGEST_STEP = 1e-4, 0.05  #: s, between two samples
CHECKS = 8  #: instants at which the answers are kept


@dataclass(frozen=True)
class Flight:
    """A flight with a loss in one rotor, and what the FMU says to it."""

    rows: NDArray[np.float32]  #: (N, inputs) inputs after every `ROW_STEPS` steps, in port order
    answers: dict[int, NDArray[np.float64]]  #: step -> (outputs,) in port order

    @property
    def steps(self) -> int:
        """Number of steps."""
        return (len(self.rows) - 1) * ROW_STEPS


@dataclass(frozen=True)
class Subject:
    """A diagnoser for a vehicle."""

    component: Component  #: its parameters start at the values for the vehicle
    vehicle: Vehicle
    step_size: float  #: s
    design: dict[str, Any] | None
    flight: Flight

    @property
    def diagnoser(self) -> str:
        """Its id."""
        return self.component.name

    @property
    def state(self) -> type:
        """Ports of what it remembers between samples."""
        state: type = import_module(f"rotordx.fmus.diagnosers.{self.diagnoser}.step").State
        return state

    @property
    def state_numbers(self) -> int:
        """Number of elements of the state."""
        return size(self.state)


def subject(diagnoser: str, vehicle: str, step_size: float = STEP_SIZE.start[0]) -> Subject:
    """Parametrise a diagnoser for a vehicle (name or path) and fly the test flight.

    Raises:
        UserError: there is no such diagnoser or vehicle, it has no gains for it, or it cannot fly with that step size.
        ComponentError: an FMU failed.
    """
    if diagnoser not in diagnoser_ids():
        raise UserError(f"{diagnoser!r} must be {one_of(diagnoser_ids(), diagnoser)}")
    if not SHORTEST_STEP <= step_size <= LONGEST_STEP:
        raise UserError(f"--step-size is {step_size:g} but must be from {SHORTEST_STEP:g} to {LONGEST_STEP:g} s")
    craft, design = vehicle_and_design(diagnoser, vehicle)
    rows = _flown(vehicle, step_size)
    component = load_component(diagnoser)
    scenario = Scenario(
        name="answers",
        system=REPLAY,
        vehicle=vehicle,
        diagnosers=[diagnoser],
        step_size_s=step_size,
        duration_s=_duration(step_size),
    )
    with System(scenario) as system:
        given = parameter_values(scenario, system.settings(scenario), system.components, craft, craft)[diagnoser]
        recording = fly(scenario, system, external=_external(interpolated(rows)))
    parametrised = dataclasses.replace(component, parameters=tuple(with_starts(c, given) for c in component.parameters))
    return Subject(parametrised, craft, step_size, design, Flight(rows, _answers(recording, component)))


def vehicle_and_design(name: str, vehicle: str) -> tuple[Vehicle, dict[str, Any] | None]:
    """A vehicle (name or path), and the design of a component for it: None if the component has no gains.

    Raises:
        UserError: there is no such vehicle, or the gains of the component are not designed for it.
    """
    try:
        craft = load_vehicle(vehicle)
        design = load_design(craft, name) if name in diagnoser_ids() else None
    except VehicleError as error:
        raise UserError(str(error)) from error
    if missing_design(craft, name):
        raise UserError(
            f"there is no design of {name} for {craft.name}, and gains for another vehicle must not fly: "
            f"make one with `rotordx design {name} --vehicle {vehicle}`"
        )
    return craft, design


def interpolated(rows: NDArray[np.float32]) -> NDArray[np.float64]:
    """(steps + 1, inputs): the rows, and straight lines in between."""
    first, second = rows[:-1].astype(float), rows[1:].astype(float)
    shares = (np.arange(ROW_STEPS) / ROW_STEPS)[:, None]
    between = first[:, None] + (second - first)[:, None] * shares
    return np.vstack([between.reshape(-1, rows.shape[1]), rows[-1].astype(float)])


def _duration(step_size: float) -> float:
    """Duration of the test flight, s: a multiple of the rows' distance."""
    distance = step_size * ROW_STEPS
    return max(1, round(DURATION / distance)) * distance


def _flown(vehicle: str, step_size: float) -> NDArray[np.float32]:
    """Rows of a simulated circle in which a rotor loses thrust, seen without sensor noise."""
    fault = {"rotor": ROTOR, "onset_s": ONSET, "loss_of_effectiveness": LOSS}
    scenario = load_scenario(
        "avram_circle",
        vehicle=vehicle,
        faults=[fault],
        diagnosers=[],
        sensor_noise=False,
        step_size_s=step_size,
        duration_s=_duration(step_size),
    )
    recording = fly(scenario)
    sources = load_layout(scenario.system).diagnoser_inputs
    return _columns(recording, [sources[p.name] for p in table(Inputs)])[::ROW_STEPS].astype(np.float32)


def _external(inputs: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Inputs by signal; row 0 initialises."""
    signals, offset = {}, 0
    for p in table(Inputs):
        part = inputs[:, offset : offset + p.size]
        signals[f"{EXTERNAL}.{p.name}"] = part if p.shape else part[:, 0]
        offset += p.size
    return signals


def _answers(recording: Recording, component: Component) -> dict[int, NDArray[np.float64]]:
    """Outputs at instants at which the verdict is settled: single precision may come to it a step earlier or later."""
    outputs = _columns(recording, [f"{component.name}.{p.name}" for p in table(component.outputs)])
    last = len(outputs) - 1
    instants = np.linspace(last / CHECKS, last, CHECKS).astype(int)
    return {int(k): outputs[k] for k in instants if k == last or (outputs[k - 2 : k + 3, :2] == outputs[k, :2]).all()}


def _columns(recording: Recording, signals: Iterable[str]) -> NDArray[np.float64]:
    """(N, elements) signals side by side."""
    return np.hstack([recording.signals[key].reshape(len(recording.time), -1) for key in signals])
