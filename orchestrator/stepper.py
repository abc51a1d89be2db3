"""Python's side of the native stepping loop (stepper.c)."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import (
    CDLL,
    CFUNCTYPE,
    POINTER,
    Structure,
    byref,
    c_bool,
    c_char_p,
    c_double,
    c_int,
    c_int32,
    c_int64,
    c_size_t,
    c_void_p,
    cast,
)
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from fmpy import sharedLibraryExtension
from numpy.typing import ArrayLike, NDArray

from rotordx.orchestrator.variables import Call, Variable

if TYPE_CHECKING:
    from rotordx.orchestrator.component import Component
    from rotordx.orchestrator.wiring import Wiring

#: What a component was doing when it failed, by the number that stepper.c gives it.
STAGES = ("setting inputs", "doStep", "reading outputs", "doStep", "doStep", "setting inputs")
#: What to say besides, by the number of the stage.
REMARKS = {3: "it asked for the end of the simulation", 4: "it returned early without having moved on"}
MISFIT = 5  #: the stage at which an input cannot be what the bus has

#: Types of values, in the order in which stepper.c numbers them.
_MEMORY = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")

LogFunction = CFUNCTYPE(None, c_int, c_char_p)


class _Call(Structure):
    _fields_ = (
        ("function", c_void_p),
        ("type", c_int32),
        ("references", c_void_p),
        ("reference_count", c_size_t),
        ("values", c_void_p),
        ("numbers", c_void_p),
        ("size", c_size_t),
        ("lowest", c_double),
        ("highest", c_double),
        ("columns", c_void_p),
        ("places", c_void_p),
        ("scale", c_void_p),
        ("offset", c_void_p),
        ("width", c_size_t),
    )


class _Component(Structure):
    _fields_ = (
        ("fmi", c_int32),
        ("substeps", c_int32),
        ("instance", c_void_p),
        ("do_step", c_void_p),
        ("inputs", c_void_p),
        ("input_count", c_size_t),
        ("outputs", c_void_p),
        ("output_count", c_size_t),
    )


class _Plan(Structure):
    _fields_ = (
        ("components", c_void_p),
        ("component_count", c_size_t),
        ("bus", c_void_p),
        ("width", c_size_t),
        ("external_width", c_size_t),
        ("step_size", c_double),
    )


class _Failure(Structure):
    _fields_ = (
        ("time", c_double),
        ("component", c_int32),
        ("stage", c_int32),
        ("status", c_int32),
        ("call", c_int32),
        ("place", c_int32),
        ("value", c_double),
    )


@cache
def library() -> CDLL:
    """The native library, stepper.c."""
    native = CDLL(str(files("rotordx.orchestrator") / f"libstepper{sharedLibraryExtension}"))
    native.rotordx_advance.argtypes = (
        POINTER(_Plan), c_int64, c_int64, c_void_p, c_void_p, c_int64, POINTER(_Failure),
    )  # fmt: skip
    native.rotordx_advance.restype = c_int64
    for function in (native.rotordx_set_inputs, native.rotordx_get_outputs):
        function.argtypes = (POINTER(_Plan), c_size_t, POINTER(_Failure))
        function.restype = c_bool
    return native


class Stepper:
    """Steps initialised components in the order of a wiring; `bus` is the present row of all signals."""

    def __init__(self, components: Sequence[Component], wiring: Wiring | None, step_size: float):
        """Plan the steps.

        Args:
            components: in the order of computation.
            wiring: None: each component is stepped with its present inputs and nothing is read.
            step_size: s.
        """
        self.components = list(components)
        self.step_size = step_size
        self.bus = np.zeros(wiring.width if wiring else 0)
        self._external_width = sum(info.width for info in wiring.external) if wiring else 0
        self._kept_alive: list[Any] = []
        entries = (_Component * len(self.components))(*(self._entry(c, wiring) for c in self.components))
        self._kept_alive.append(entries)
        self._plan = _Plan(
            cast(entries, c_void_p),
            len(entries),
            self.bus.ctypes.data,
            self.bus.size,
            self._external_width,
            step_size,
        )

    def advance(
        self,
        first: int,
        count: int,
        *,
        external: NDArray[np.float64] | None = None,
        log: NDArray[np.float64] | None = None,
        log_every: int = 1,
    ) -> None:
        """Make `count` steps, the first of them from t = first * step_size.

        Args:
            first: number of steps made before.
            count: number of steps to make.
            external: (count, external width) values of the external signals in each step; None: they are held.
            log: (n, width), C-contiguous; gets the bus after each step whose number is a multiple of `log_every`.
            log_every: see `log`.

        Raises:
            ComponentError: a component failed, or asked for the end of the simulation.
        """
        for array, shape in (
            (external, (count, self._external_width)),
            (log, ((first + count) // log_every - first // log_every, self.bus.size)),
        ):
            if array is not None and not (array.shape == shape and array.dtype == float and array.flags.c_contiguous):
                raise ValueError(f"external signals and log must be C-contiguous float64 arrays, here of shape {shape}")
        failure = _Failure()
        done = library().rotordx_advance(
            byref(self._plan), first, count, _address(external), _address(log), log_every, byref(failure)
        )
        if done < count:
            self._raise(failure)

    def set_inputs(self, component: int) -> None:
        """Set the inputs of the component with this number from the bus; only in the initialisation, at t = 0.

        Raises:
            ComponentError: the component refuses them.
        """
        failure = _Failure()
        if not library().rotordx_set_inputs(byref(self._plan), component, byref(failure)):
            self._raise(failure)

    def get_outputs(self, component: int) -> None:
        """Put the outputs of the component with this number on the bus; only in the initialisation, at t = 0.

        Raises:
            ComponentError: the component refuses that.
        """
        failure = _Failure()
        if not library().rotordx_get_outputs(byref(self._plan), component, byref(failure)):
            self._raise(failure)

    def _raise(self, failure: _Failure) -> NoReturn:
        component = self.components[failure.component]
        if failure.stage == MISFIT:
            component.messages.append(_about_misfit(list(component.inputs.values()), failure))
        component.messages += filter(None, [REMARKS.get(failure.stage)])
        raise component.failure(STAGES[failure.stage], failure.time, failure.status)

    def _entry(self, component: Component, wiring: Wiring | None) -> _Component:
        """One component as stepper.c sees it; what it points to is kept alive with the stepper."""
        entry = _Component(
            fmi=component.fmi,
            substeps=component.substeps,
            instance=component.instance,
            do_step=component.function("DoStep"),
        )
        if wiring is None:
            return entry
        columns = wiring.inputs[component.name]
        inputs = [self._input(component, call, columns) for call in Call.all_for(component.inputs.values())]
        first = next((wiring.columns[f"{component.name}.{port}"].start for port in component.outputs), 0)
        outputs = [self._output(component, call, first) for call in Call.all_for(component.outputs.values())]
        for calls, name in ((inputs, "input"), (outputs, "output")):
            array = (_Call * len(calls))(*calls)
            self._kept_alive.append(array)
            setattr(entry, f"{name}s", cast(array, c_void_p))
            setattr(entry, f"{name}_count", len(calls))
        return entry

    def _input(self, component: Component, call: Call, columns: Sequence[int]) -> _Call:
        entry = self._call(component, "Set", call)
        order = np.argsort(call.places)
        entry.columns, _ = self._kept(np.array(columns)[np.array(call.elements)[order]], "u4")
        if call.converts:  # the other way round: value of the call = (value of the element - offset) / scale
            scale, offset = np.array(call.scale)[order], np.array(call.offset)[order]
            entry.scale, _ = self._kept(1 / scale)
            entry.offset, _ = self._kept(-offset / scale)
        return entry

    def _output(self, component: Component, call: Call, first: int) -> _Call:
        """A call that reads outputs; those of the component begin in column `first` of the bus."""
        entry = self._call(component, "Get", call)
        in_order = call.elements == tuple(range(call.size)) == call.places
        if in_order and call.access.memory == "f8" and not call.converts:
            entry.values = entry.numbers = self.bus[first:].ctypes.data
            return entry
        entry.columns, entry.width = self._kept(first + np.array(call.elements), "u4")
        entry.places, _ = self._kept(call.places, "u4")
        if call.converts:
            entry.scale, _ = self._kept(call.scale)
            entry.offset, _ = self._kept(call.offset)
        return entry

    def _call(self, component: Component, verb: str, call: Call) -> _Call:
        numbers, size = self._kept(np.zeros(call.size))
        memory = call.access.memory
        entry = _Call(
            function=component.function(f"{verb}{call.access.suffix}"),
            type=_MEMORY.index(memory),
            values=numbers if memory == "f8" else self._kept(np.zeros(call.size), memory)[0],
            numbers=numbers,
            size=size,
            lowest=call.access.lowest,
            highest=call.access.highest,
        )
        entry.references, entry.reference_count = self._kept(call.references, "u4")
        return entry

    def _kept(self, values: ArrayLike, memory: str = "f8") -> tuple[int, int]:
        """(address, number) of values that live as long as the stepper."""
        array: NDArray[Any] = np.array(values, dtype=memory)
        self._kept_alive.append(array)
        return array.ctypes.data, array.size


def _about_misfit(inputs: Sequence[Variable], failure: _Failure) -> str:
    """What an input should have been and cannot be."""
    call = Call.all_for(inputs)[failure.call]
    element = call.elements[call.places.index(failure.place)]
    names = [f"{v.name}[{i + 1}]" if v.shape else v.name for v in inputs for i in range(v.size)]
    kinds = [v.type for v in inputs for _ in range(v.size)]
    return (
        f"{names[element]} would be {failure.value:g}, but the FMU takes {kinds[element]} values from "
        f"{call.access.lowest:.0f} to {call.access.highest:.0f}"
    )


def _address(array: NDArray[np.float64] | None) -> int | None:
    return None if array is None else array.ctypes.data
