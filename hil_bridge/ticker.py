"""The ticks of a flight over a bus: a command goes out, speeds come back, and what each tick worked with is noted."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from rotordx.hil_bridge.buses import BusError, open_bus
from rotordx.hil_bridge.escs import Escs
from rotordx.hil_bridge.link import Link
from rotordx.hil_bridge.messages import LOCKSTEP_TYPES
from rotordx.hil_bridge.motors import largest_speed
from rotordx.hil_bridge.pacing import wait_until
from rotordx.hil_bridge.protocol import NAME, ROTORS, Array
from rotordx.hil_bridge.settings import COMMANDED, REAL, BridgeSettings
from rotordx.orchestrator.flight import FlightEnded, Signals
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.wiring import EXTERNAL

COMMAND, LOSS = "controller.rotor_speed_command", "esc.loss_of_effectiveness"  #: signals that a tick reads
SPEED, FED = f"{EXTERNAL}.rotor_speed", f"{EXTERNAL}.rotor_speed_command"  #: and sets: of the rotors, for diagnosers

LOCKSTEP_TIMEOUT = 5.0  #: s in which a step has to be made, whatever else the machine does
SPIN_UP = 2.0  #: s in which real motors reach the speeds of the first command
DEGRADED_WINDOW, DEGRADED_SHARE = 1.0, 0.15  #: s, share of its ticks without a fresh answer
LONG_BEFORE = 1e6  #: s


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
        signals[SPEED] = self.escs.speed
        if FED in signals:
            fed = sent if not self._real else signals[COMMAND]
            signals[FED] = fed if self._settings.fed_speed == COMMANDED else self.escs.speed
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
def ticking(scenario: Scenario, settings: BridgeSettings) -> Iterator[Ticker]:
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
