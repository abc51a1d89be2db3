"""The motors behind an ESC emulator: the same esc FMU as in a simulated flight, and what they draw from the battery."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rotordx.fmus.esc.ports import COMPONENT
from rotordx.fmus.shell.ports import table
from rotordx.fmus.vehicles import load_vehicle
from rotordx.hil_bridge.protocol import ROTORS, Array
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System
from rotordx.orchestrator.wiring import EXTERNAL

_COMMAND, _SPEED = f"{EXTERNAL}.rotor_speed_command", "esc.rotor_speed"
_NAME = "esc"


def largest_speed(vehicle: str) -> float:
    """Largest rotor speed (rad/s) of a vehicle, what setpoints are relative to."""
    return float(np.max(load_vehicle(vehicle).parameters["rotor_speed_max"]))


def esc_scenario(scenario: Scenario) -> Scenario:
    """What a scenario says about the ESCs: vehicle, faults, sag, parameters of the component esc, and the step size."""
    own = {port.name for group in COMPONENT.parameters for port in table(group)}
    settings = scenario.components.get(_NAME)
    return scenario.changed(
        system=str(Path(str(files("rotordx.hil_bridge") / "esc.toml"))),
        diagnosers=[],
        connections=[],
        gusts=None,
        parameters={name: value for name, value in scenario.parameters.items() if name in own},
        components={} if settings is None else {_NAME: settings.model_dump(exclude_none=True)},
    )


class Motors:
    """Four motors that stand still until they are started; used in a `with` statement or closed."""

    def __init__(self, scenario: Scenario):
        """Load the esc FMU.

        Args:
            scenario: its faults count from the start of the motors.

        Raises:
            UserError: what the scenario says about the ESCs is impossible.
            ComponentError: the FMU cannot be loaded.
        """
        self._scenario = esc_scenario(scenario)
        self._system = System(self._scenario)
        self.step_size = self._scenario.step_size_s  #: s
        self.largest_speed = largest_speed(scenario.vehicle)  #: rad/s
        self.speed: Array = np.zeros(ROTORS)  #: (4,) rad/s
        self._steps: int | None = None

    @property
    def running(self) -> bool:
        """Whether they have been started."""
        return self._steps is not None

    def step(self, command: ArrayLike) -> None:
        """One step with a command (4,) in rad/s; the first one starts the motors at the speeds commanded.

        Raises:
            ComponentError: the FMU failed.
        """
        values = np.asarray(command, dtype=float)
        if self._steps is None:
            self._system.initialise(self._scenario, external=values)
            self._steps = 0
        self._system.signal(_COMMAND)[:] = values
        self._system.stepper.advance(self._steps, 1)
        self._steps += 1
        self.speed = self._system.signal(_SPEED).copy()

    def stop(self) -> None:
        """Brake: they stand still at once, and the next step is the first one of a new run."""
        self._steps = None
        self.speed = np.zeros(ROTORS)

    def close(self) -> None:
        """Free the FMU."""
        self._system.close()


class PowerTrain:
    """Current, voltage and temperature of the ESCs from their rotors' speeds.

    A rotor takes the power k Ω³ from its motor, which takes it with a constant efficiency from a battery with an inner
    resistance; a share of the electrical power heats the ESC, which cools with one time constant. The figures are those
    of a 3-cell battery and 20 A ESCs; nothing in the flight depends on them.
    """

    OPEN_VOLTAGE, BATTERY_RESISTANCE = 12.4, 0.02  #: V, Ω
    EFFICIENCY = 0.8
    HEAT_SHARE, THERMAL_RESISTANCE, THERMAL_TIME = 0.05, 6.0, 25.0  #: 1, K/W, s
    AMBIENT = 298.15  #: K

    def __init__(self, vehicle: str):
        """Cold ESCs of a vehicle."""
        self._torque: Array = np.array(load_vehicle(vehicle).parameters["torque_coefficient"])
        self._largest_power = self._torque * largest_speed(vehicle) ** 3
        self.power: Array = np.zeros(ROTORS)  #: (4,) W, mechanical
        self.current: Array = np.zeros(ROTORS)  #: (4,) A
        self.voltage = self.OPEN_VOLTAGE  #: V
        self.temperature: Array = np.full(ROTORS, self.AMBIENT)  #: (4,) K

    @property
    def rating(self) -> Array:
        """(4,) percent of the largest power."""
        return 100 * self.power / self._largest_power

    def update(self, speed: Array, elapsed: float) -> None:
        """Go on by some time (s) with speeds (4,) in rad/s."""
        self.power = self._torque * speed**3
        electrical = self.power / self.EFFICIENCY
        # V = V0 - R I and I = P / V, whose larger solution is the one a battery works at.
        root = self.OPEN_VOLTAGE**2 / 4 - self.BATTERY_RESISTANCE * float(electrical.sum())
        self.voltage = self.OPEN_VOLTAGE / 2 + math.sqrt(max(0.0, root))
        self.current = electrical / self.voltage
        settled = self.AMBIENT + self.THERMAL_RESISTANCE * self.HEAT_SHARE * electrical
        self.temperature = settled + math.exp(-elapsed / self.THERMAL_TIME) * (self.temperature - settled)
