"""The native loop calls an FMU with the right times and values, and stops at the first status that is not good."""

from __future__ import annotations

import math
from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, c_bool, c_double, c_int, c_size_t, c_uint32, c_void_p, cast
from dataclasses import dataclass, field

import numpy as np
import pytest

from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.recording import SignalInfo
from rotordx.orchestrator.stepper import Stepper
from rotordx.orchestrator.variables import ACCESS, Element, Variable
from rotordx.orchestrator.wiring import Wiring

STEP_SIZE = 0.1
FLOAT64 = ACCESS[3]["Float64"]
SET = CFUNCTYPE(c_int, c_void_p, POINTER(c_uint32), c_size_t, POINTER(c_double), c_size_t)
DO_STEP = CFUNCTYPE(c_int, c_void_p, c_double, c_double, c_bool, *[POINTER(c_bool)] * 3, POINTER(c_double))


@dataclass
class Double:
    """An FMI 3 component made of Python functions: its output `y` is its input `u` doubled."""

    do_step: Callable[[float], tuple[int, bool]] = lambda time: (0, False)
    statuses: dict[str, int] = field(default_factory=dict)
    name: str = "double"
    fmi: int = 3
    substeps: int = 1
    instance: int = 0

    def __post_init__(self) -> None:
        self.messages: list[str] = []
        self.times: list[float] = []
        self.value = math.nan
        self.inputs = {"u": Variable("u", "Float64", FLOAT64, "input", "1", "", None, (Element(7),), None, 0, 0, {})}
        self.outputs = {"y": Variable("y", "Float64", FLOAT64, "output", "1", "", None, (Element(9),), None, 0, 0, {})}
        self.functions = {"SetFloat64": SET(self.set), "GetFloat64": SET(self.get)}
        self.functions["DoStep"] = DO_STEP(self.step)

    def function(self, name: str) -> c_void_p:
        return cast(self.functions[name], c_void_p)

    def failure(self, activity: str, time: float, status: int) -> ComponentError:
        return ComponentError(self.name, time, f"{activity}, status {status}", self.messages)

    def set(self, _, references, count, values, size) -> int:
        assert (references[0], count, size) == (7, 1, 1)
        self.value = values[0]
        return self.statuses.get("set", 0)

    def get(self, _, references, count, values, size) -> int:
        assert (references[0], count, size) == (9, 1, 1)
        values[0] = 2 * self.value
        return self.statuses.get("get", 0)

    def step(self, _, time, step_size, __, event, terminate, early, last) -> int:
        assert step_size == STEP_SIZE
        self.times.append(time)
        status, terminate[0] = self.do_step(time)
        return status


def stepper_of(component: Double) -> Stepper:
    signals = [SignalInfo("external.u", "1", ""), SignalInfo("double.y", "1", "")]
    columns = {"external.u": slice(0, 1), "double.y": slice(1, 2)}
    return Stepper([component], Wiring(["double"], signals, columns, {"double": [0]}), STEP_SIZE)


def test_time_is_never_summed_up():
    component = Double()
    stepper = stepper_of(component)
    stepper.advance(0, 7)
    stepper.advance(7, 1000)
    assert component.times == [k * STEP_SIZE for k in range(1007)]


def test_external_rows_come_before_a_step_and_log_rows_after_it():
    stepper = stepper_of(Double())
    external, log = np.arange(1.0, 9.0)[:, None], np.zeros((2, 2))
    stepper.advance(2, 8, external=external, log=log, log_every=4)  # steps 3 to 10, of which 4 and 8 are logged
    assert np.array_equal(log, [[2.0, 4.0], [6.0, 12.0]])
    assert np.array_equal(stepper.bus, [8.0, 16.0])


def test_external_signals_are_held_without_rows():
    stepper = stepper_of(Double())
    stepper.bus[0] = 21.0
    stepper.advance(0, 3)
    assert np.array_equal(stepper.bus, [21.0, 42.0])


@pytest.mark.parametrize(
    ("statuses", "do_step", "message"),
    [
        ({"set": 3}, lambda time: (0, False), "double failed at t = 0 s in setting inputs, status 3: "),
        ({}, lambda time: (2 if time > 0.45 else 0, False), "double failed at t = 0.5 s in doStep, status 2: "),
        ({"get": 4}, lambda time: (0, False), "double failed at t = 0 s in reading outputs, status 4: "),
        (
            {},
            lambda time: (0, time > 0.45),
            "double failed at t = 0.5 s in doStep, status 0: it asked for the end",
        ),
    ],
)
def test_the_first_status_that_is_not_good_ends_it(statuses, do_step, message):
    component = Double(do_step, statuses)
    with pytest.raises(ComponentError) as error:
        stepper_of(component).advance(0, 10)
    assert str(error.value).startswith(message)
    assert len(component.times) <= 6


def test_a_warning_does_not_end_it():
    component = Double(lambda time: (1, False), {"set": 1, "get": 1})
    stepper_of(component).advance(0, 10)
    assert len(component.times) == 10


@pytest.mark.parametrize("log", [np.zeros((9, 2)), np.zeros((10, 2), dtype=np.float32), np.zeros((2, 10)).T])
def test_memory_that_does_not_fit_is_refused_before_the_first_step(log):
    component = Double()
    with pytest.raises(ValueError, match="must be C-contiguous float64 arrays"):
        stepper_of(component).advance(0, 10, log=log)
    assert not component.times
