"""Flies a scenario whose rotors are on a bus: commands go out, and the flight goes on with what comes back."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rotordx.hil_bridge.buses import BusAddress, BusError, open_bus
from rotordx.hil_bridge.emulator import EscSettings
from rotordx.hil_bridge.escs import Escs
from rotordx.hil_bridge.link import Link
from rotordx.hil_bridge.load import RAW, Plan, plan
from rotordx.hil_bridge.messages import LOCKSTEP_TYPES
from rotordx.hil_bridge.motors import largest_speed
from rotordx.hil_bridge.own_emulator import own_emulator
from rotordx.hil_bridge.pacing import undisturbed, wait_until
from rotordx.hil_bridge.protocol import NAME, ROTORS, Array
from rotordx.hil_bridge.timing import figures
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import FlightEnded, Signals, fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System
from rotordx.orchestrator.wiring import EXTERNAL

OWN, RUNNING, REAL = "own", "running", "real"  #: emulated by us, by a process that runs already; real ESCs
COMMANDED, MEASURED = "commanded", "measured"  #: the rotor speed that diagnosers are fed

COMMAND, TRUE_SPEED, LOSS = "controller.rotor_speed_command", "esc.rotor_speed", "esc.loss_of_effectiveness"
_SPEED, _FED = f"{EXTERNAL}.rotor_speed", f"{EXTERNAL}.rotor_speed_command"

PRESENCE_TIMEOUT = 15.0  #: s in which all ESCs have to be heard of
LOCKSTEP_TIMEOUT = 5.0  #: s in which a step has to be made, whatever else the machine does
SPIN_UP = 2.0  #: s in which real motors reach the speeds of the first command
DEGRADED_WINDOW, DEGRADED_SHARE = 1.0, 0.15  #: s, share of its ticks without a fresh answer
LONG_BEFORE = 1e6  #: s
NO_LAG = 1e-6  #: s, time constant of motors whose speed is measured


@dataclass(frozen=True)
class BridgeSettings:
    """What is on the bus and how it is flown."""

    bus: BusAddress
    lockstep: bool = False
    escs: str = OWN
    setup: EscSettings = field(default_factory=EscSettings)
    command: str = RAW
    fed_speed: str = COMMANDED
    watchdog: float = 0.25  #: s of silence of an ESC after which the flight ends
    fifo: bool = False  #: ask for SCHED_FIFO and locked memory
    spin_margin: float = 200e-6  #: s
    bit_rate: float = 1e6  #: bit/s of the bus, for its load
    propellers_are_off: bool = False

    def __post_init__(self) -> None:
        if self.bus.is_real and not self.propellers_are_off:
            raise UserError(
                f"--bus {self.bus}: motors may hang on this bus and will turn: take the propellers off and say so with "
                "--i-know-propellers-are-off"
            )
        if self.lockstep and self.escs == REAL:
            raise UserError("real ESCs do not wait: --lockstep needs emulated ones")
        if self.bus.is_in_process and self.escs != OWN:
            raise UserError(f"--bus {self.bus}: no other process can reach this bus, fly it with --escs own")
        if not self.watchdog > 0:
            raise UserError(f"--watchdog must be positive, not {self.watchdog:g}")

    def plan(self, scenario: Scenario) -> Plan:
        """What will be on the bus."""
        setup = self.setup
        return plan(
            scenario.step_size_s,
            setup.status_rate,
            setup.nodes.escs,
            command=self.command,
            emulated=self.escs != REAL,
            bit_rate=self.bit_rate,
        )


@dataclass(frozen=True)
class BridgedFlight:
    """A flight over a bus; `verdict` is None if it came to its end."""

    recording: Recording
    figures: dict[str, Any]  #: plain data, see `timing.figures`
    verdict: str | None


def fly_over_bus(
    scenario: Scenario, settings: BridgeSettings, progress: Callable[[float], None] | None = None
) -> BridgedFlight:
    """Fly a scenario with its rotors on a bus.

    The esc FMU of the flight goes on as a model of what the ESCs should do: it tells which losses act, for the scores
    and, with real ESCs, for what the commands are reduced by; the plant gets what came over the bus.

    Args:
        scenario: the flight.
        settings: the bus.
        progress: called now and then with the time flown (s).

    Raises:
        UserError: the scenario is impossible over this bus.
        BusError: there is no such bus, no ESC answers, or the bus was lost before the flight began.
        ComponentError: an FMU failed.
    """
    settings.plan(scenario).check()
    with ExitStack() as stack:
        ticker = stack.enter_context(_ticker(scenario, settings))
        if settings.escs == OWN:
            stack.enter_context(own_emulator(settings.bus.perfect, scenario, settings.setup, fifo=settings.fifo))
        flown = bridged_scenario(scenario, settings.fed_speed)
        system = stack.enter_context(System(flown))
        system.initialise(flown)
        hover = system.signal(TRUE_SPEED).copy()
        ticker.escs.wait_until_present(PRESENCE_TIMEOUT)
        granted = stack.enter_context(undisturbed(fifo=settings.fifo))
        stack.callback(ticker.escs.stop)
        recording = fly(
            flown,
            system,
            initial=dict.fromkeys((info.key for info in system.wiring.external), hover),
            callback=ticker,
            progress=_rarely(progress),
        )
    report = figures(recording, scenario, settings, ticker, granted)
    return BridgedFlight(_described(recording, ticker), report, ticker.verdict)


def bridged_scenario(scenario: Scenario, fed_speed: str) -> Scenario:
    """The scenario in which plant and diagnosers take rotor speeds from outside."""
    own = {connection["to"] for connection in (c.model_dump(by_alias=True) for c in scenario.connections)}
    targets = {"plant.rotor_speed": _SPEED, **{f"{name}.rotor_speed_command": _FED for name in scenario.diagnosers}}
    connections = [{"from": source, "to": target} for target, source in targets.items() if target not in own]
    components = {name: settings.model_dump(exclude_none=True) for name, settings in scenario.components.items()}
    if fed_speed == MEASURED:
        for name in scenario.diagnosers:
            settings = components.setdefault(name, {})
            settings["parameters"] = {"motor_time_constant": NO_LAG} | settings.get("parameters", {})
    return scenario.changed(
        connections=[*(c.model_dump(by_alias=True) for c in scenario.connections), *connections], components=components
    )


class Ticker:
    """One tick of the flight after the other: the callback of `fly`.

    Before step k, the command that the controller made in step k - 1 is sent, and the answer to it awaited: in lock
    step until it is there, in real time until the instant of step k. So a command acts one tick later than without a
    bus, and diagnosers are fed the command that acts over the step.
    """

    def __init__(self, scenario: Scenario, settings: BridgeSettings, link: Link, escs: Escs):
        self.escs, self.link = escs, link
        self.ticks = 0
        self.verdict: str | None = None
        self.degraded_at: float | None = None  #: s, first instant at which too few answers were fresh
        self.host_load = [round(value, 2) for value in os.getloadavg()]  #: over 1, 5, 15 min, before the flight
        self.held = 0  #: ticks without a fresh answer
        rows = scenario.steps + 1
        self.rpm: Array = np.full((rows, ROTORS), np.nan)
        self.status_age: Array = np.full((rows, ROTORS), np.nan)
        self.answer_age: Array = np.full(rows, np.nan)
        self.lateness: Array = np.full(rows, np.nan)
        self.degraded: Array = np.zeros(rows)
        self._settings = settings
        self._real = settings.escs == REAL
        self._step = scenario.step_size_s
        self._created = time.monotonic()
        self._begin: float | None = None  # on the machine's clock, the instant of t = 0
        self._recent: deque[bool] = deque(maxlen=round(DEGRADED_WINDOW / self._step))
        self._recently_held = 0

    def clock(self) -> float:
        """Time of the flight (s): steps in lock step, else by the machine; long before 0 until it begins."""
        if self._begin is None:
            return time.monotonic() - self._created - LONG_BEFORE
        return self.ticks * self._step if self._settings.lockstep else time.monotonic() - self._begin

    def __call__(self, now: float, signals: Signals) -> None:
        """Exchange command and speeds before a step.

        Raises:
            FlightEnded: bus or ESCs are lost; the reason is the verdict.
            BusError: so before the first step.
        """
        try:
            command = signals[COMMAND]
            if self.ticks == 0:
                self._start(command)
            if self._real:
                command *= np.sqrt(1 - signals[LOSS])
            sent = self.escs.command(command)
            self._exchange()
            silence, who = self.escs.silent_for(self.clock())
            if silence > self._settings.watchdog:
                raise BusError(f"{who} has been silent for {1e3 * silence:.0f} ms")
        except BusError as error:
            if self.ticks == 0:
                raise
            self.verdict = f"ended at {now:.3f} s: {error}"
            raise FlightEnded from error
        signals[_SPEED] = self.escs.speed
        if _FED in signals:
            fed = sent if not self._real else signals[COMMAND]
            signals[_FED] = fed if self._settings.fed_speed == COMMANDED else self.escs.speed
        self._note()

    def _start(self, command: Array) -> None:
        """Arm; real motors are given the time to reach the speeds (4,) in rad/s of the first command.

        What has come while the flight was prepared is taken before, for it may have filled the receive buffer.
        """
        self.escs.listen()
        self.escs.arm()
        if self._settings.lockstep:
            self.escs.make_step(0, LOCKSTEP_TIMEOUT)
        if self._real:
            begin = time.monotonic()
            for k in range(round(SPIN_UP / self._step)):
                self.escs.command(command)
                wait_until(begin + k * self._step, 0.0)
                self.escs.listen()
            self.escs.check_speeds()
        else:
            self.escs.speed = command
        self._begin = time.monotonic() + self._step
        self.escs.forget(self.clock())
        self.link.forget()

    def _exchange(self) -> None:
        if self._begin is None or self._settings.lockstep:
            self.escs.make_step(self.ticks + 1, LOCKSTEP_TIMEOUT)
            return
        self.lateness[self.ticks + 1] = wait_until(self._begin + self.ticks * self._step, self._settings.spin_margin)
        self.escs.listen()

    def _note(self) -> None:
        """Log what this tick worked with, as values at its end."""
        row, now = self.ticks + 1, self.clock()
        escs = self.escs
        held = not self._real and escs.answered != 0
        self.held += held
        self._recently_held += held - (self._recent[0] if len(self._recent) == self._recent.maxlen else 0)
        self._recent.append(held)
        degraded = self._recently_held > DEGRADED_SHARE * self._recent.maxlen if self._recent.maxlen else False
        if degraded and self.degraded_at is None:
            self.degraded_at = self.ticks * self._step
        self.rpm[row], self.status_age[row], self.degraded[row] = escs.rpm, now - escs.status_at, degraded
        self.answer_age[row] = escs.answer_age(now)
        self.ticks += 1


@contextmanager
def _ticker(scenario: Scenario, settings: BridgeSettings) -> Iterator[Ticker]:
    """A ticker with its end of the bus, which is shut down at the end."""
    nodes = settings.setup.nodes

    def clock() -> float:
        return ticker.clock()

    bus = open_bus(settings.bus, clock, LOCKSTEP_TYPES, {nodes.controller})
    link = Link(bus, {nodes.controller: f"{NAME}.controller"}, Escs.expected(nodes), clock)
    escs = Escs(
        link,
        nodes,
        largest_speed(scenario.vehicle),
        command=settings.command,
        emulated=settings.escs != REAL,
        step=scenario.step_size_s,
    )
    ticker = Ticker(scenario, settings, link, escs)
    try:
        yield ticker
    finally:
        link.close()


def _described(recording: Recording, ticker: Ticker) -> Recording:
    """The recording with the telemetry; rotor speeds as they came over the bus take the place of the model's."""
    rows = len(recording.time)
    telemetry = {
        "bus.rpm": (ticker.rpm, "1/min", "rotor speed of each ESC's last Status"),
        "bus.status_age": (ticker.status_age, "s", "time since that Status came"),
        "bus.answer_age": (ticker.answer_age, "s", "time since the command was sent that the rotor speeds answer"),
        "bus.lateness": (ticker.lateness, "s", "how late the step was begun, in real time"),
        "bus.degraded": (ticker.degraded, "1", "1: too few of the last second's answers were fresh"),
    }
    signals, units, descriptions = dict(recording.signals), dict(recording.units), dict(recording.descriptions)
    for key, (values, unit, description) in telemetry.items():
        signals[key], units[key], descriptions[key] = values[:rows], unit, description
    for old, new in ((TRUE_SPEED, "esc_model.rotor_speed"), (_SPEED, TRUE_SPEED), (_FED, "bus.rotor_speed_command")):
        if old in signals:
            signals[new], units[new] = signals.pop(old), units.pop(old)
            descriptions[new] = descriptions.pop(old)
    descriptions[TRUE_SPEED] = "as it came over the bus"
    return replace(recording, signals=signals, units=units, descriptions=descriptions)


def _rarely(progress: Callable[[float], None] | None) -> Callable[[float], None] | None:
    """Progress twice a second of machine time, for showing it takes a good part of a tick."""
    if progress is None:
        return None
    shown = 0.0

    def show(now: float) -> None:
        nonlocal shown
        if time.monotonic() - shown > 0.5:
            shown = time.monotonic()
            progress(now)

    return show
