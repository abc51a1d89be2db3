"""A small driver that runs an FMU of either FMI version through FMPy under the names of its ports."""

from __future__ import annotations

import ctypes
import itertools
import re
from dataclasses import dataclass, field

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from numpy.typing import NDArray

from rotordx.fmus import component_names, diagnoser_ids

STEP = 0.002
NAMES = component_names() + diagnoser_ids()
FMUS = [pytest.param(name, fmi, id=f"{name}-fmi{fmi}") for name, fmi in itertools.product(NAMES, (2, 3))]


@dataclass
class Port:
    """A port as an importer sees it: the elements `name[1]`, ... of FMI 2 are put together again."""

    name: str
    causality: str
    variability: str
    choices: list[str]
    unit: str
    references: list[int] = field(default_factory=list)
    elements: list[str] = field(default_factory=list)
    start: list[float] = field(default_factory=list)
    minimum: float = -np.inf
    maximum: float = np.inf

    @property
    def enumeration(self) -> bool:
        return bool(self.choices)


def _choices(variable: fmpy.model_description.ModelVariable) -> list[str]:
    return [item.name for item in variable.declaredType.items] if variable.type == "Enumeration" else []


def read_ports(description: fmpy.model_description.ModelDescription) -> dict[str, Port]:
    """Ports by name in the order of the model description; the independent variable is left out."""
    ports: dict[str, Port] = {}
    for v in description.modelVariables:
        if v.causality == "independent":
            continue
        name, index = re.fullmatch(r"(\w+?)(\[\d+\])?", v.name).groups()
        port = ports.setdefault(name, Port(name, v.causality, v.variability, _choices(v), v.unit or ""))
        size = int(v.dimensions[0].start) if v.dimensions else 1
        port.references += [v.valueReference + i for i in range(size)]
        port.elements += [v.name] if index or not v.dimensions else [f"{v.name}[{i + 1}]" for i in range(size)]
        start = str(v.start).split() if v.start is not None else []
        port.start += [float(x) for x in start]
        port.minimum = -np.inf if v.min is None else float(v.min)
        port.maximum = np.inf if v.max is None else float(v.max)
    return ports


class Instance:
    """One instance; calls that the FMU refuses raise FMPy's FMICallException and leave their message in `messages`."""

    def __init__(
        self,
        name: str,
        fmi: int,
        folder: str,
        *,
        token: str | None = None,
        debug: bool = False,
        messages: list[str] | None = None,
    ):
        self.fmi = fmi
        self.messages = [] if messages is None else messages
        self.description = fmpy.read_model_description(folder)
        self.ports = read_ports(self.description)
        arguments = {
            "guid": token or self.description.guid,
            "unzipDirectory": folder,
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
            "instanceName": f"{name} 1",
        }
        if fmi == 2:
            self.fmu = FMU2Slave(**arguments)
            self._callbacks = fmi2CallbackFunctions()
            ctypes.memmove(
                ctypes.byref(self._callbacks), ctypes.byref(defaultCallbacks), ctypes.sizeof(self._callbacks)
            )
            self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log2)
            self.fmu.instantiate(callbacks=self._callbacks, loggingOn=debug)
        else:
            self.fmu = FMU3Slave(**arguments)
            self.fmu.instantiate(loggingOn=debug, logMessage=self._log3)
        self.time = 0.0

    def _log2(self, environment, instance_name, status, category, message):
        self.messages.append(f"{category.decode()}: {message.decode()}")

    def _log3(self, environment, status, category, message):
        self.messages.append(f"{category.decode()}: {message.decode()}")

    def names(self, causality: str) -> list[str]:
        return [p.name for p in self.ports.values() if p.causality == causality]

    def set(self, name: str, values) -> None:
        port = self.ports[name]
        values = np.atleast_1d(values).tolist()
        if port.enumeration:
            write = self.fmu.setInteger if self.fmi == 2 else self.fmu.setInt64
            write(port.references, [int(v) for v in values])
        elif self.fmi == 2:
            self.fmu.setReal(port.references, values)
        else:
            self.fmu.setFloat64(port.references[:1], values)

    def get(self, name: str) -> NDArray:
        port = self.ports[name]
        if port.enumeration:
            get = self.fmu.getInteger if self.fmi == 2 else self.fmu.getInt64
            return np.array(get(port.references), float)
        if self.fmi == 2:
            return np.array(self.fmu.getReal(port.references))
        return np.array(self.fmu.getFloat64(port.references[:1], len(port.references)))

    def all(self, *causalities: str) -> dict[str, NDArray]:
        """Values of all ports of these causalities, by port name."""
        return {name: self.get(name) for causality in causalities for name in self.names(causality)}

    def outputs(self) -> bytes:
        """All outputs, bit by bit."""
        return b"".join(value.tobytes() for value in self.all("output").values())

    def enter_initialisation(self, start_time: float = 0.0) -> None:
        if self.fmi == 2:
            self.fmu.setupExperiment(startTime=start_time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start_time)
        self.time = start_time

    def initialise(self, start_time: float = 0.0) -> None:
        self.enter_initialisation(start_time)
        self.fmu.exitInitializationMode()

    def step(self, step_size: float = STEP) -> None:
        self.fmu.doStep(self.time, step_size)
        self.time += step_size

    def fly(self, stimulus: Stimulus, steps: int) -> list[bytes]:
        """Outputs after each of `steps` steps under the stimulus."""
        history = []
        for _ in range(steps):
            for name, values in stimulus.inputs().items():
                self.set(name, values)
            self.step()
            history.append(self.outputs())
        return history

    def free(self) -> None:
        self.fmu.freeInstance()


class Stimulus:
    """Seeded random inputs and parameters in plausible ranges for the ports of an FMU."""

    def __init__(self, instance: Instance, seed: int = 1):
        self.ports = instance.ports
        self.rng = np.random.default_rng(seed)

    def inputs(self) -> dict[str, NDArray]:
        return {p.name: self._value(p) for p in self.ports.values() if p.causality == "input"}

    def _value(self, p: Port) -> NDArray:
        size = len(p.references)
        if "rotor_speed" in p.name:
            return 550 + 50 * self.rng.standard_normal(size)
        return 0.2 * self.rng.standard_normal(size)

    def parameters(self) -> dict[str, NDArray]:
        """Every parameter with a dimension, up to one per cent off its start."""
        values = {}
        for p in self.ports.values():
            if p.causality == "parameter" and p.name != "step_size" and p.unit not in {"1", ""}:
                off = np.array(p.start) * (1 + 0.01 * self.rng.uniform(-1, 1, len(p.start)))
                values[p.name] = np.clip(off, p.minimum, p.maximum)
        return values
