"""Python's side of the native stepping loop (stepper.c)."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import (
    CDLL,
    CFUNCTYPE,
    POINTER,
    Structure,
    byref,
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
from typing import TYPE_CHECKING, Any

import numpy as np
from fmpy import sharedLibraryExtension
from numpy.typing import ArrayLike, NDArray

from rotordx.orchestrator.variables import Exchange

if TYPE_CHECKING:
    from rotordx.orchestrator.component import Component
    from rotordx.orchestrator.wiring import Wiring

#: What a component was doing when it failed, by the number that stepper.c gives it.
STAGES = ("setting inputs", "doStep", "reading outputs", "doStep", "doStep")
#: What to say besides, by the number of the stage.
REMARKS = {3: "it asked for the end of the simulation", 4: "it returned early without having moved on"}

LogFunction = CFUNCTYPE(None, c_int, c_char_p)


class _Component(Structure):
    _fields_ = (
        ("fmi", c_int32),
        ("substeps", c_int32),
        ("instance", c_void_p),
        ("set", c_void_p),
        ("do_step", c_void_p),
        ("get", c_void_p),
        ("input_references", c_void_p),
        ("input_reference_count", c_size_t),
        ("input_size", c_size_t),
        ("input_columns", c_void_p),
        ("input_scale", c_void_p),
        ("input_offset", c_void_p),
        ("inputs", c_void_p),
        ("output_references", c_void_p),
        ("output_reference_count", c_size_t),
        ("output_size", c_size_t),
        ("outputs", c_void_p),
        ("output_places", c_void_p),
        ("output_scale", c_void_p),
        ("output_offset", c_void_p),
        ("output_width", c_size_t),
        ("converted_outputs", c_void_p),
    )


class _Plan(Structure):
    _fields_ = (
        ("components", c_void_p),
        ("component_count", c_size_t),
        ("bus", c_void_p),
        ("width", c_size_t),
        ("external_width", c_size_t),
        ("start_time", c_double),
        ("step_size", c_double),
    )


class _Failure(Structure):
    _fields_ = (("time", c_double), ("component", c_int32), ("stage", c_int32), ("status", c_int32))


@cache
def library() -> CDLL:
    """The native library: `rotordx_advance` and, for FMI 2, the logger `rotordx_fmi2_log`."""
    native = CDLL(str(files("rotordx.orchestrator") / f"libstepper{sharedLibraryExtension}"))
    native.rotordx_advance.argtypes = (
        POINTER(_Plan), c_int64, c_int64, c_void_p, c_void_p, c_int64, POINTER(_Failure),
    )  # fmt: skip
    native.rotordx_advance.restype = c_int64
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
            0.0,
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
            component = self.components[failure.component]
            component.messages += filter(None, [REMARKS.get(failure.stage)])
            raise component.failure(STAGES[failure.stage], failure.time, failure.status)

    def _entry(self, component: Component, wiring: Wiring | None) -> _Component:
        """One component as stepper.c sees it; what it points to is kept alive with the stepper."""
        real = ("fmi2{}Real", "fmi3{}Float64")
        entry = _Component(
            fmi=component.fmi,
            substeps=component.substeps,
            instance=component.instance,
            set=component.function(*(name.format("Set") for name in real)),
            do_step=component.function("fmi2DoStep", "fmi3DoStep"),
            get=component.function(*(name.format("Get") for name in real)),
        )
        if wiring is None:
            return entry
        columns, inputs = wiring.inputs[component.name], Exchange.of(component.inputs.values())
        column_of = dict(zip(inputs.places, columns, strict=True))
        entry.input_references, entry.input_reference_count = self._kept(inputs.references, np.uint32)
        entry.input_columns, entry.input_size = self._kept([column_of[i] for i in range(inputs.size)], np.uint32)
        entry.inputs, _ = self._kept(np.zeros(inputs.size))
        if not inputs.plain:
            order = np.argsort(inputs.places)
            scale, offset = (np.array(values)[order] for values in inputs.inverse)
            entry.input_scale, _ = self._kept(scale)
            entry.input_offset, _ = self._kept(offset)
        outputs = Exchange.of(component.outputs.values())
        first = next((wiring.columns[f"{component.name}.{port}"].start for port in component.outputs), 0)
        entry.output_references, entry.output_reference_count = self._kept(outputs.references, np.uint32)
        entry.output_size, entry.outputs = outputs.size, self.bus[first:].ctypes.data
        if not outputs.plain:
            entry.converted_outputs, (entry.outputs, _) = entry.outputs, self._kept(np.zeros(outputs.size))
            entry.output_places, entry.output_width = self._kept(outputs.places, np.uint32)
            entry.output_scale, _ = self._kept(outputs.scale)
            entry.output_offset, _ = self._kept(outputs.offset)
        return entry

    def _kept(self, values: ArrayLike, kind: type = np.float64) -> tuple[int, int]:
        """(address, number) of values that live as long as the stepper."""
        array: NDArray[Any] = np.array(values, dtype=kind)
        self._kept_alive.append(array)
        return array.ctypes.data, array.size


def _address(array: NDArray[np.float64] | None) -> int | None:
    return None if array is None else array.ctypes.data
