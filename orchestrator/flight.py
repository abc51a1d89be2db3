"""Flies a scenario: initialise, step to the end, and hand over what was recorded."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.orchestrator import interruption
from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.stepper import Stepper
from rotordx.orchestrator.system import System
from rotordx.orchestrator.wiring import EXTERNAL

CHUNK = 500  #: steps between two looks at Ctrl-C and two reports of progress, well below 10 ms
TIMED_STEPS, TIMED_ROUNDS = 500, 5


class FlightEnded(Exception):
    """Raised by a callback that ends a flight before its time; what was flown until then is recorded."""


class Signals(Mapping[str, NDArray[np.float64]]):
    """The present values of a flight's signals, as a callback sees them; the external ones can be set."""

    def __init__(self, system: System):
        self._system = system

    def __getitem__(self, key: str) -> NDArray[np.float64]:
        """Copy of the values of "component.port", always as an array."""
        return self._system.signal(key).copy()

    def __setitem__(self, key: str, values: ArrayLike) -> None:
        """Set an external signal from the next step on.

        Raises:
            KeyError: every other signal is the output of a component, which writes it in each step.
        """
        if not key.startswith(f"{EXTERNAL}.") or key not in self._system.wiring.columns:
            raise KeyError(
                f"{key} cannot be set, only external signals can: connect the input that you want to drive "
                f'from = "{EXTERNAL}.name"'
            )
        self._system.signal(key)[:] = values

    def __iter__(self) -> Iterator[str]:
        return iter(self._system.wiring.columns)

    def __len__(self) -> int:
        return len(self._system.wiring.columns)


def fly(
    scenario: Scenario,
    system: System | None = None,
    *,
    actual_vehicle: Vehicle | None = None,
    external: Mapping[str, ArrayLike] | None = None,
    initial: Mapping[str, ArrayLike] | None = None,
    callback: Callable[[float, Signals], None] | None = None,
    callback_decimation: int = 1,
    log_every: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Fly a scenario from t = 0 to its end.

    Args:
        scenario: the flight.
        system: one to use again, see `System`; None: one is made for this flight and freed after it.
        actual_vehicle: the vehicle as it is, if controller and diagnosers do not know it exactly.
        external: all external signals over time, (steps + 1, size) or (steps + 1,) each: row 0 initialises, row k is
            what the step that ends at t = k h works with. None: they keep their initial values until the callback
            sets them.
        initial: initial values of all external signals, (size,) or () each, if `external` is None; None: 0.
        callback: called with the time (s) and the signals before every n-th step, first at t = 0; it may raise
            `FlightEnded`.
        callback_decimation: this n.
        log_every: the recording has the initial values, and those after every n-th step.
        progress: called now and then with the time flown (s).

    Raises:
        UserError: the scenario is impossible.
        ComponentError: an FMU failed.
        ValueError: `system` was made for another kind of scenario, or `external` does not fit.
    """
    with ExitStack() as stack:
        if system is None:
            system = stack.enter_context(System(scenario))
        rows = None if external is None else _external_rows(external, system, scenario.steps)
        held = rows
        if rows is None and initial is not None:
            held = _external_rows({key: np.reshape(values, (1, -1)) for key, values in initial.items()}, system, 0)
        begin = time.perf_counter()
        system.initialise(scenario, actual_vehicle, None if held is None else held[0])
        log = np.empty((system.wiring.width, scenario.steps // log_every + 1)).T  # so that each signal is contiguous
        log[0] = system.stepper.bus
        buffer = np.empty((CHUNK, system.wiring.width))
        signals = Signals(system)
        done = 0
        while done < scenario.steps:
            interruption.check()
            count = min(CHUNK, scenario.steps - done)
            if callback is not None:
                if done % callback_decimation == 0:
                    try:
                        callback(done * scenario.step_size_s, signals)
                    except FlightEnded:
                        break
                count = min(count, callback_decimation - done % callback_decimation)
            logged, logged_after = done // log_every + 1, (done + count) // log_every + 1
            chunk = buffer[: logged_after - logged]
            inputs = None if rows is None else rows[done + 1 : done + 1 + count]
            system.stepper.advance(done, count, external=inputs, log=chunk, log_every=log_every)
            log[logged:logged_after] = chunk
            done += count
            if progress is not None:
                progress(done * scenario.step_size_s)
        wall_time, duration = time.perf_counter() - begin, done * scenario.step_size_s
        return Recording.from_log(
            np.arange(0, done + 1, log_every, dtype=float) * scenario.step_size_s,
            log[: done // log_every + 1],
            system.wiring.signals,
            scenario=scenario.plain() | ({} if done == scenario.steps else {"duration_s": duration}),
            faults=[fault.model_dump(exclude_none=True) for fault in scenario.faults],
            diagnosers=list(scenario.diagnosers),
            measurements={
                "wall_time_s": wall_time,
                "real_time_factor": duration / wall_time,
                "messages": {name: list(c.messages) for name, c in system.components.items() if c.messages},
                "step_time_ns": {name: _step_time_ns(system, name, done) for name in scenario.diagnosers},
            },
        )


def _external_rows(external: Mapping[str, ArrayLike], system: System, steps: int) -> NDArray[np.float64]:
    """(steps + 1, width) the external signals in the order of the bus."""
    expected = {info.key: info for info in system.wiring.external}
    if set(external) != set(expected):
        raise ValueError(f"external signals must be {', '.join(expected)}, but are {', '.join(external)}")
    columns = []
    for key, info in expected.items():
        values = np.asarray(external[key], dtype=float)
        if values.shape not in {(steps + 1, info.width)} | ({(steps + 1,)} if info.shape is None else set()):
            raise ValueError(f"{key} has the shape {values.shape}, but must have ({steps + 1}, {info.width})")
        columns.append(values.reshape(steps + 1, info.width))
    return np.ascontiguousarray(np.hstack(columns))


def _step_time_ns(system: System, name: str, step: int) -> float | None:
    """Computing time of one doStep of a component after a flight, ns: the best of a few rounds; None if it fails."""
    alone = Stepper([system.components[name]], None, system.stepper.step_size)
    best = None
    for i in range(TIMED_ROUNDS):
        begin = time.perf_counter_ns()
        try:
            alone.advance(step + i * TIMED_STEPS, TIMED_STEPS)
        except ComponentError:
            return None
        elapsed = (time.perf_counter_ns() - begin) / TIMED_STEPS
        best = elapsed if best is None else min(best, elapsed)
    return best
