"""One FMU instance, the same to its users whether it speaks FMI 2 or FMI 3."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from ctypes import byref, c_double, c_int, c_void_p, cast
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
    fmi2LastSuccessfulTime,
    fmi2Terminated,
)
from fmpy.fmi3 import FMU3Slave

from rotordx.orchestrator.archive import Archive
from rotordx.orchestrator.errors import RunError
from rotordx.orchestrator.layout import ComponentSettings
from rotordx.orchestrator.library import with_optional_functions
from rotordx.orchestrator.stepper import LogFunction, library
from rotordx.orchestrator.variables import Variable, read_variables

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
DISCARD, FATAL = STATUS.index("discard"), STATUS.index("fatal")

_PYTHON_TYPE = {"Real": float, "Float64": float, "Float32": float, "Boolean": bool, "String": str}


def _named(status: int) -> str:
    """The name of a status, also of one that FMI does not have."""
    return STATUS[status] if 0 <= status < len(STATUS) else str(status)


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

    def __init__(self, name: str, archive: Archive, settings: ComponentSettings):
        """Load the FMU's library and instantiate it.

        Args:
            name: of the instance.
            archive: the extracted FMU.
            settings: its ports and steps.

        Raises:
            UserError: the ports do not fit the FMU.
            ComponentError: the FMU cannot be loaded or instantiated.
        """
        self.name = name
        self.fmi = archive.fmi
        self.substeps = settings.substeps or 1
        self.messages: list[str] = []  #: what the FMU has logged since its last reset
        self.variables = read_variables(archive.description, settings.ports, name)
        self._used = False
        self._fatal = False
        self.fmu: Any = None  #: FMPy's object
        self._load(archive, settings)

    @cached_property
    def inputs(self) -> dict[str, Variable]:
        """Inputs that can be connected, by port name."""
        return {name: v for name, v in self.variables.items() if v.causality == "input" and v.is_number}

    @cached_property
    def outputs(self) -> dict[str, Variable]:
        """Outputs that can be connected and logged, by port name."""
        return {name: v for name, v in self.variables.items() if v.causality == "output" and v.is_number}

    @cached_property
    def parameters(self) -> dict[str, Variable]:
        """What can be set before a flight: parameters that are numbers or strings, and inputs that are strings."""
        settable = {True: ("parameter",), False: ("parameter", "input")}
        numbers_and_texts = ((name, v) for name, v in self.variables.items() if v.is_number or v.type == "String")
        return {name: v for name, v in numbers_and_texts if v.causality in settable[v.is_number]}

    @property
    def instance(self) -> c_void_p:
        """The FMU's own handle."""
        handle: c_void_p = self.fmu.component
        return handle

    def function(self, name: str) -> c_void_p:
        """Address of one of the FMU's functions, named without the version of FMI, for example "DoStep"."""
        return cast(getattr(self.fmu.dll, f"fmi{self.fmi}{name}"), c_void_p)

    def reset(self) -> None:
        """Back to the state after instantiation."""
        self.messages.clear()
        if self._used:
            with self._calling("reset"):
                self.fmu.reset()
        self._used = False

    def set_parameters(self, values: Mapping[str, Sequence[Any]]) -> None:
        """Set the elements of parameters by name, between a reset and the initialisation."""
        by_setter: dict[str, tuple[list[int], list[Any]]] = {}
        for name, elements in values.items():
            variable = self.parameters[name]
            setter = f"set{variable.access.suffix if variable.access else variable.type}"
            references, flat = by_setter.setdefault(setter, ([], []))
            references.extend(variable.references)
            flat.extend(_PYTHON_TYPE.get(variable.type, int)(element) for element in elements)
        self._used = True
        with self._calling("setting parameters"):
            for setter, (references, flat) in by_setter.items():
                getattr(self.fmu, setter)(references, flat)

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

    def failure(self, activity: str, time: float, status: int) -> ComponentError:
        """What to raise when a call has returned a status that is not good."""
        self._fatal = status == FATAL
        remarks = self._about_discarded_step() if activity == "doStep" and status == DISCARD else []
        messages = [*self.messages, *remarks] or [f"status {_named(status)}, no message"]
        return ComponentError(self.name, time, activity, messages)

    def close(self) -> None:
        """Free the instance and its library, after which the component cannot be used."""
        fmu, self.fmu = self.fmu, None
        if fmu is not None and fmu.component and not self._fatal:
            fmu.freeInstance()

    def _load(self, archive: Archive, settings: ComponentSettings) -> None:
        """Make the instance."""
        arguments = {
            "guid": archive.description.guid,
            "modelIdentifier": archive.description.coSimulation.modelIdentifier,
            "unzipDirectory": str(archive.folder),
            "instanceName": self.name,
        }
        with self._calling("instantiation"):
            kind = with_optional_functions(FMU2Slave if self.fmi == 2 else FMU3Slave, self.messages.append)
            self.fmu = kind(**arguments)
            if self.fmi == 2:
                self.fmu.instantiate(callbacks=self._fmi2_callbacks())
            else:
                self.fmu.instantiate(logMessage=lambda _, status, category, message: self._log(status, message))

    def _about_discarded_step(self) -> list[str]:
        """What an FMI 2 FMU tells about a step that it has discarded; FMI 3 has other ways to say it."""
        if self.fmi == 3:
            return []
        reached, terminated = c_double(), c_int()
        with suppress(FMICallException):
            self.fmu.fmi2GetBooleanStatus(self.instance, fmi2Terminated, byref(terminated))
            if terminated.value:
                return ["it asked for the end of the simulation"]
            self.fmu.fmi2GetRealStatus(self.instance, fmi2LastSuccessfulTime, byref(reached))
            return [f"it came to t = {reached.value:.9g} s only, try more substeps"]
        return []

    def _log(self, status: int, message: bytes | None) -> None:
        text = (message or b"").decode(errors="replace").strip()
        self.messages.append(text if status == 0 else f"{_named(status)}: {text}")

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
