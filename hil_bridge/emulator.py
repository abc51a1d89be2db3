"""ESC emulator: four speed controllers on a bus that fly the esc FMU, stop when nobody commands, and report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from rotordx.hil_bridge.buses import BusAddress, open_bus
from rotordx.hil_bridge.link import Link, Received
from rotordx.hil_bridge.messages import (
    LOCKSTEP_TYPES,
    ArmingStatus,
    Message,
    NodeStatus,
    RawCommand,
    RotorSpeeds,
    RPMCommand,
    SpeedsRequest,
    Status,
    StatusExtended,
    StepDone,
    StepRequest,
)
from rotordx.hil_bridge.motors import Motors, PowerTrain
from rotordx.hil_bridge.protocol import (
    EXTENDED_DIVIDER,
    NAME,
    NODE_STATUS_PERIOD,
    ROTORS,
    Nodes,
    commanded_speed,
    to_counts,
    to_rpm,
)
from rotordx.hil_bridge.transfer import TRANSFER_IDS
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.scenario import Scenario

LOCKSTEP_TIMEOUT = 10.0  #: s without a request after which lock step is over and the motors stop
LARGEST_DELAY = 0.5  #: s that steps made up for; what the machine stood still for longer is not caught up with
OFFLINE = 7  #: mode of NodeStatus
ZERO_CELSIUS = 273.15  #: K


@dataclass(frozen=True)
class EscSettings:
    """How the ESCs are set up."""

    nodes: Nodes = field(default_factory=Nodes)
    stale_after: float = 0.25  #: s without a fresh command after which the motors stop
    status_rate: float = 100.0  #: Hz, of each ESC's Status

    def __post_init__(self) -> None:
        if not self.stale_after > 0:
            raise UserError(f"ESCs must stop after a positive time without commands, not {self.stale_after:g} s")
        if not 0.1 <= self.status_rate <= 1000:
            raise UserError(f"the rate of Status must be 0.1 to 1000 Hz, not {self.status_rate:g}")


class Emulator:
    """ESCs that share one end of a bus and one clock.

    Motors turn while the ESCs are armed, and a command that asks for speed is not older than `stale_after`. A stop by
    stale commands lasts until the ESCs have been disarmed; commands of all zeros stop as well. Every start begins at
    the commanded speeds, with the clock of the faults at 0.

    In real time, a fresh command triggers the step that is due around then; without one the step comes half a step
    later from the emulator's own clock. So answers follow commands at once, and time goes on without them. In lock
    step (from the first `StepRequest` on) there are only the steps that are asked for, and no clock of the machine.
    """

    def __init__(self, bus: BusAddress, scenario: Scenario, settings: EscSettings):
        """Open the bus and load the motors.

        Raises:
            BusError: there is no such bus.
            UserError: what the scenario says about the ESCs is impossible.
        """
        nodes = settings.nodes
        self._settings = settings
        self._lockstep_time: float | None = None
        self._motors = Motors(scenario)
        self._power = PowerTrain(scenario.vehicle)
        try:
            end = open_bus(bus, self.clock, LOCKSTEP_TYPES)
        except BaseException:
            self._motors.close()
            raise
        from_controller: dict[type[Message], set[int]] = {
            kind: {nodes.controller} for kind in (ArmingStatus, RawCommand, RPMCommand, SpeedsRequest, StepRequest)
        }
        names = {node: f"{NAME}.esc{i}" for i, node in enumerate(nodes.esc_ids, start=1)}
        self.link = Link(end, names, from_controller, self.clock)
        self._step = self._motors.step_size
        per_second = 1 / self._step
        self._status_every = max(1, round(per_second / settings.status_rate))
        self._node_status_every = round(per_second * NODE_STATUS_PERIOD)
        self._armed = self._stale = self._speeds_wanted = False
        self._command = np.zeros(ROTORS)
        self._command_id = 0
        self._command_at: float | None = None
        self._missed = 0
        self._ticks = 0
        self._deadline = time.monotonic() + self._step  # of the next step on our own clock
        self._last_request = 0.0

    def clock(self) -> float:
        """Time (s): of the lock step, else of the machine."""
        return time.monotonic() if self._lockstep_time is None else self._lockstep_time

    def run(self, finished: Callable[[], bool] = lambda: False) -> None:
        """Serve until told otherwise.

        Raises:
            BusError: the bus is lost; the motors stand still.
        """
        try:
            while not finished():
                in_lockstep = self._lockstep_time is not None
                wait = 0.1 if in_lockstep else max(0.0, self._deadline - time.monotonic())
                received = self.link.receive(wait)
                if received is not None:
                    self._handle(received)
                now = time.monotonic()
                if self._lockstep_time is not None:
                    if now - self._last_request > LOCKSTEP_TIMEOUT:
                        self._leave_lockstep(now)
                elif now >= self._deadline:
                    behind = LARGEST_DELAY if self._motors.running else 0.0
                    self._deadline = max(self._deadline, now - behind) + self._step
                    self._tick()
            for node in self.link.nodes:
                self.link.send(node, NodeStatus(self.link.uptime, mode=OFFLINE))
        finally:
            self._motors.stop()

    def close(self) -> None:
        """Leave the bus and free the motors."""
        self.link.close()
        self._motors.close()

    def _handle(self, received: Received) -> None:
        match received.message:
            case ArmingStatus(status):
                self._arm(status == ArmingStatus.FULLY_ARMED)
            case RawCommand() | RPMCommand() as message:
                command = commanded_speed(message, self._motors.largest_speed)
                if command is not None:
                    self._take(command, received.transfer_id)
            case SpeedsRequest():
                self._speeds_wanted = self._armed
            case StepRequest(number):
                self._answer(number)

    def _arm(self, armed: bool) -> None:
        if not armed:
            self._motors.stop()
            self._stale = self._speeds_wanted = False
        elif not self._armed:
            self._command_at = None
            self._missed = 0
        self._armed = armed

    def _take(self, command: np.ndarray, transfer_id: int) -> None:
        """A fresh command: it refreshes the watchdog, and triggers the step that is due about now."""
        if self._command_at is not None:
            self._missed += (transfer_id - self._command_id - 1) % TRANSFER_IDS
        self._check_stale()
        self._command, self._command_id, self._command_at = command, transfer_id, self.clock()
        if self._lockstep_time is None:
            now = time.monotonic()
            if self._may_turn() and not self._motors.running:
                self._deadline = now + 1.5 * self._step
                self._tick()
            elif self._deadline - now <= self._step:
                self._deadline += self._step
                self._tick()

    def _may_turn(self) -> bool:
        return self._armed and not self._stale and self._command_at is not None and bool(self._command.any())

    def _check_stale(self) -> None:
        if self._armed and self._command_at is not None:
            self._stale |= self.clock() - self._command_at > self._settings.stale_after

    def _tick(self) -> None:
        """One step of the motors, and the reports that are due."""
        self._check_stale()
        if self._may_turn():
            self._motors.step(self._command)
        else:
            self._motors.stop()
        first = self._settings.nodes.first_esc
        if self._speeds_wanted:
            counts = to_counts(self._motors.speed, self._motors.largest_speed)
            self.link.send(first, RotorSpeeds((counts[0], counts[1], counts[2], counts[3]), self._command_id & 0xF))
        if self._ticks % self._status_every == 0:
            self._power.update(self._motors.speed, self._status_every * self._step)
        for i in range(self._settings.nodes.escs):
            self._report(i)
        self._ticks += 1

    def _report(self, esc: int) -> None:
        """What ESC number `esc` (from 0) has to say in this step; the ESCs take turns, so that the bus is even."""
        node = self._settings.nodes.first_esc + esc
        share = esc / self._settings.nodes.escs
        since = self._ticks - int(share * self._status_every)
        if since >= 0 and since % self._status_every == 0:
            rpm, power = to_rpm(self._motors.speed)[esc], self._power
            rating, temperature = round(power.rating[esc]), float(power.temperature[esc])
            current = float(power.current[esc])
            self.link.send(node, Status(self._missed, power.voltage, current, temperature, rpm, rating, esc))
            if since % (self._status_every * EXTENDED_DIVIDER) == 0:
                asked = round(100 * float(self._command[esc]) / self._motors.largest_speed)
                turned = round(100 * float(self._motors.speed[esc]) / self._motors.largest_speed)
                celsius = round(temperature - ZERO_CELSIUS)
                self.link.send(node, StatusExtended(asked, turned, celsius, 0, int(self._stale), esc))
        if (self._ticks - int(share * self._node_status_every)) % self._node_status_every == 0 or self._ticks == 0:
            self.link.send(node, NodeStatus(self.link.uptime))

    def _answer(self, number: int) -> None:
        """Lock step: request 0 begins it with motors that stand still, every other one asks for a step."""
        self._last_request = time.monotonic()
        if number == 0:
            self._motors.stop()
            self._stale, self._ticks, self._missed, self._command_at = False, 0, 0, None
            self._lockstep_time = 0.0
        elif self._lockstep_time is None:
            return
        else:
            self._lockstep_time = number * self._step
            self._tick()
        self.link.send(self._settings.nodes.first_esc, StepDone(number))

    def _leave_lockstep(self, now: float) -> None:
        self._lockstep_time = None
        self._arm(False)
        self._deadline = now + self._step


@contextmanager
def emulated(bus: BusAddress, scenario: Scenario, settings: EscSettings) -> Iterator[Emulator]:
    """An emulator that is closed at the end."""
    emulator = Emulator(bus, scenario, settings)
    try:
        yield emulator
    finally:
        emulator.close()
