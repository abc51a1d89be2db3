"""One FMU instance, the same to its users whether it speaks FMI 2 or FMI 3."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import c_void_p, cast
from functools import cached_property
from typing import Any

from fmpy import calloc, free
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import FMU3Slave

from rotordx.orchestrator.archive import Archive
from rotordx.orchestrator.errors import RunError
from rotordx.orchestrator.stepper import LogFunction, library
from rotordx.orchestrator.variables import Variable, read_variables

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
FATAL = STATUS.index("fatal")

#: FMI type -> suffix of FMPy's method that sets it, where it is not the type itself
_SETTER = {("Enumeration", 2): "Integer", ("Enumeration", 3): "Int64"}
_PYTHON_TYPE = {"Real": float, "Float64": float, "Float32": float, "Boolean": bool, "String": str}


class ComponentError(RunError):
    """An FMU failed; the message names the component, the time, what it was to do and what it logged."""

    def __init__(self, component: str, time: float, activity: str, messages: Sequence[str]):
        super().__init__(f"{component} failed at t = {time:.9g} s in {activity}: {'; '.join(messages)}")
        self.component = component
        self.time = time
        self.activity = activity
        self.messages = list(messages)


class Component:
    """An instance of an FMU: created, reset, parametrised and initialised here, stepped by the native stepper."""

    def __init__(self, name: str, archive: Archive, ports: Mapping[str, Sequence[str]]):
        """Load the FMU's library and instantiate it.

        Args:
            name: of the instance.
            archive: the extracted FMU.
            ports: names of ports that differ from those of the FMU's variables, see `read_variables`.

        Raises:
            UserError: `ports` does not fit the FMU.
            ComponentError: the FMU cannot be loaded or instantiated.
        """
        self.name = name
        self.fmi = archive.fmi
        self.messages: list[str] = []  #: what the FMU has logged since its last reset
        self.variables = read_variables(archive.description, ports, name)
        self._used = False
        self._fatal = False
        arguments = {
            "guid": archive.description.guid,
            "modelIdentifier": archive.description.coSimulation.modelIdentifier,
            "unzipDirectory": str(archive.folder),
            "instanceName": name,
        }
        self.fmu: Any = None  #: FMPy's object
        with self._calling("instantiation"):
            self.fmu = FMU2Slave(**arguments) if self.fmi == 2 else FMU3Slave(**arguments)
            if self.fmi == 2:
                self.fmu.instantiate(callbacks=self._fmi2_callbacks())
            else:
                self.fmu.instantiate(logMessage=lambda _, status, category, message: self._log(status, message))

    @cached_property
    def inputs(self) -> dict[str, Variable]:
        """Inputs that can be connected, by port name."""
        return {name: v for name, v in self.variables.items() if v.causality == "input" and v.is_real}

    @cached_property
    def outputs(self) -> dict[str, Variable]:
        """Outputs that can be connected and logged, by port name."""
        return {name: v for name, v in self.variables.items() if v.causality == "output" and v.is_real}

    @cached_property
    def parameters(self) -> dict[str, Variable]:
        """What can be set before a flight: parameters, and inputs that cannot be connected."""
        return {
            name: v
            for name, v in self.variables.items()
            if v.causality == "parameter" or (v.causality == "input" and not v.is_real)
        }

    @property
    def instance(self) -> c_void_p:
        """The FMU's own handle."""
        handle: c_void_p = self.fmu.component
        return handle

    def function(self, fmi2: str, fmi3: str) -> c_void_p:
        """Address of one of the FMU's functions, which has a name in either version of FMI."""
        return cast(getattr(self.fmu.dll, fmi2 if self.fmi == 2 else fmi3), c_void_p)

    def reset(self) -> None:
        """Back to the state after instantiation."""
        self.messages.clear()
        if self._used:
            with self._calling("reset"):
                self.fmu.reset()
        self._used = False

    def set_parameters(self, values: Mapping[str, Sequence[Any]]) -> None:
        """Set the elements of parameters by name, between a reset and the initialisation."""
        by_type: dict[str, tuple[list[int], list[Any]]] = {}
        for name, elements in values.items():
            variable = self.parameters[name]
            references, flat = by_type.setdefault(variable.type, ([], []))
            references.extend(variable.references)
            flat.extend(_PYTHON_TYPE.get(variable.type, int)(element) for element in elements)
        self._used = True
        with self._calling("setting parameters"):
            for kind, (references, flat) in by_type.items():
                getattr(self.fmu, f"set{_SETTER.get((kind, self.fmi), kind)}")(references, flat)

    def enter_initialization(self) -> None:
        """Enter initialisation mode, at t = 0."""
        self._used = True
        with self._calling("entering initialisation mode"):
            if self.fmi == 2:
                self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()

    def exit_initialization(self) -> None:
        """Leave initialisation mode, ready to step."""
        with self._calling("initialisation"):
            self.fmu.exitInitializationMode()

    def set_inputs(self, values: Sequence[float]) -> None:
        """Set all inputs, in the order of `inputs`."""
        references = [r for variable in self.inputs.values() for r in variable.references]
        with self._calling("setting inputs"):
            (self.fmu.setReal if self.fmi == 2 else self.fmu.setFloat64)(references, values)

    def get_outputs(self) -> list[float]:
        """All outputs, in the order of `outputs`."""
        references = [r for variable in self.outputs.values() for r in variable.references]
        values: list[float]
        with self._calling("reading outputs"):
            if self.fmi == 2:
                values = self.fmu.getReal(references)
            else:
                values = self.fmu.getFloat64(references, sum(variable.size for variable in self.outputs.values()))
        return values

    def failure(self, activity: str, time: float, status: int) -> ComponentError:
        """What to raise when a call has returned a status that is not good."""
        self._fatal = status == FATAL
        return ComponentError(self.name, time, activity, self.messages or [f"status {STATUS[status]}, no message"])

    def close(self) -> None:
        """Free the instance and its library, after which the component cannot be used."""
        fmu, self.fmu = self.fmu, None
        if fmu is not None and fmu.component and not self._fatal:
            fmu.freeInstance()

    def _log(self, status: int, message: bytes | None) -> None:
        text = (message or b"").decode(errors="replace").strip()
        self.messages.append(text if status == 0 else f"{STATUS[status] if status < len(STATUS) else status}: {text}")

    def _fmi2_callbacks(self) -> fmi2CallbackFunctions:
        """Callbacks with our native logger; FMPy's sends the messages of all FMUs to the last one that asked."""
        self._log_function = LogFunction(self._log)
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = cast(library().rotordx_fmi2_log, fmi2CallbackLoggerTYPE)
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        callbacks.componentEnvironment = cast(self._log_function, c_void_p)
        return callbacks

    @contextmanager
    def _calling(self, activity: str) -> Iterator[None]:
        try:
            yield
        except FMICallException as error:
            raise self.failure(activity, 0.0, error.status) from error
        except Exception as error:  # FMPy raises plain Exception where loading or instantiating fails
            raise ComponentError(self.name, 0.0, activity, [*self.messages, str(error)]) from error
