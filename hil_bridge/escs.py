"""The ESCs as a flight controller sees them over a bus: commanded, listened to, believed while they talk."""

from __future__ import annotations

import time
from collections import Counter, deque

import numpy as np

from rotordx.hil_bridge.buses import BusError
from rotordx.hil_bridge.link import Link, Received
from rotordx.hil_bridge.load import RAW
from rotordx.hil_bridge.messages import (
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
from rotordx.hil_bridge.protocol import (
    ARMING_PERIOD,
    NODE_STATUS_PERIOD,
    ROTORS,
    Array,
    Nodes,
    from_counts,
    from_rpm,
    to_counts,
    to_rpm,
)
from rotordx.hil_bridge.transfer import TRANSFER_IDS

COMMAND_IDS = 16  #: what RotorSpeeds tells of a command's transfer id
LAST_WORDS = 3  #: times that the motors are told to stop


class Escs:
    """Four ESCs, emulated or real."""

    def __init__(self, link: Link, nodes: Nodes, largest_speed: float, *, command: str, emulated: bool, step: float):
        """Listen; nobody is armed.

        Args:
            link: expects from the ESCs what `expected` says.
            nodes: their ids and ours.
            largest_speed: rad/s, of full scale.
            command: "raw" or "rpm".
            emulated: whether they are emulated, and so send RotorSpeeds after each of their steps; else the speeds of
                their Status are held.
            step: s between two commands.
        """
        self.speed: Array = np.full(ROTORS, np.nan)  #: (4,) rad/s, the last ones known
        self.rpm: Array = np.full(ROTORS, np.nan)  #: (4,) 1/min of the last Status
        self.status_at: Array = np.full(ROTORS, -np.inf)  #: (4,) s, when that came
        self.heard_at = -np.inf  #: s, when the speeds came
        self.answered: int | None = None  #: commands since the one that the last speeds answer; None: they answer none
        self.present: set[int] = set()  #: nodes heard of
        self.lost: Counter[str] = Counter()  #: data type -> transfers that did not arrive, by gaps in transfer ids
        self.late = 0  #: RotorSpeeds that answered an older command than the last one
        self.answers = 0  #: RotorSpeeds that came
        self._link, self._nodes, self._largest_speed = link, nodes, largest_speed
        self._raw, self._emulated, self._step = command == RAW, emulated, step
        self._command_id = 0
        self._sent_at: deque[float] = deque(maxlen=COMMAND_IDS)
        self._last_ids: dict[tuple[str, int], int] = {}
        self._commands = 0

    @staticmethod
    def expected(nodes: Nodes) -> dict[type[Message], set[int]]:
        """What a link has to accept from whom."""
        escs = set(nodes.esc_ids)
        return {
            Status: escs,
            StatusExtended: escs,
            NodeStatus: escs,
            RotorSpeeds: {nodes.first_esc},
            StepDone: {nodes.first_esc},
        }

    def wait_until_present(self, timeout: float) -> None:
        """Wait until every ESC has been heard of.

        Raises:
            BusError: one has not been in time (s).
        """
        end = time.monotonic() + timeout
        while not self.present.issuperset(self._nodes.esc_ids):
            left = end - time.monotonic()
            if left <= 0:
                missing = ", ".join(str(node) for node in self._nodes.esc_ids if node not in self.present)
                raise BusError(
                    f"no ESC answers on {self._link.bus.channel_info} for the node ids {missing}: check power, wiring "
                    "and ids, or let rotordx emulate ESCs (--escs own)"
                )
            received = self._link.receive(min(left, 0.1))
            if received is not None:
                self._take(received)

    def arm(self, armed: bool = True) -> None:
        """Arm or disarm; armed emulators are asked for RotorSpeeds."""
        status = ArmingStatus.FULLY_ARMED if armed else ArmingStatus.DISARMED
        self._link.send(self._nodes.controller, ArmingStatus(status))
        if armed and self._emulated:
            self._link.send(self._nodes.controller, SpeedsRequest())

    def command(self, speed: Array) -> Array:
        """Send a command (4,) in rad/s, and in between what a controller has to say; the speeds as sent, (4,).

        Raises:
            BusError: the bus is lost.
        """
        if self._commands % max(1, round(ARMING_PERIOD / self._step)) == 0:
            self.arm()
        if self._commands % max(1, round(NODE_STATUS_PERIOD / self._step)) == 0:
            self._link.send(self._nodes.controller, NodeStatus(self._link.uptime))
        self._commands += 1
        sent: RawCommand | RPMCommand
        if self._raw:
            sent = RawCommand(tuple(to_counts(speed, self._largest_speed)))
            result = from_counts(sent.setpoints, self._largest_speed)
        else:
            sent = RPMCommand(tuple(to_rpm(speed)))
            result = from_rpm(sent.rpm)
        self._command_id = self._link.send(self._nodes.controller, sent)
        self._sent_at.append(self._link.now())
        self.answered = None if self.answered is None else self.answered + 1
        return result

    def stop(self) -> None:
        """Zero and disarm, several times, as long as the bus takes it."""
        try:
            for _ in range(LAST_WORDS):
                zero = (0,) * ROTORS
                self._link.send(self._nodes.controller, RawCommand(zero) if self._raw else RPMCommand(zero))
                self.arm(False)
        except BusError:
            pass  # ESCs stop by themselves when nothing reaches them

    def listen(self) -> None:
        """Take what has arrived.

        Raises:
            BusError: the bus is lost.
        """
        for received in self._link.drain():
            self._take(received)

    def make_step(self, number: int, timeout: float) -> None:
        """Lock step: have a step made, and take what arrives until it is done.

        Raises:
            BusError: the bus is lost, or nobody has made the step in time (s).
        """
        self._link.send(self._nodes.controller, StepRequest(number))
        end = time.monotonic() + timeout
        while True:
            received = self._link.receive(max(0.0, end - time.monotonic()))
            if received is None:
                raise BusError(f"the emulator has not made its step in {timeout:g} s")
            if isinstance(received.message, StepDone):
                if received.message.number == number:
                    self.listen()
                    return
            else:
                self._take(received)

    def forget(self, now: float) -> None:
        """Take this instant (s) for the one at which they were last heard, and nothing for lost so far."""
        self.heard_at = now
        self.status_at[:] = now
        self.lost.clear()
        self.late = self.answers = 0
        self.answered = None
        if self._emulated:
            self.rpm[:] = np.nan
        self._last_ids.clear()

    def check_speeds(self) -> None:
        """Make sure that every ESC has told its speed.

        Raises:
            BusError: one has not.
        """
        for esc in np.flatnonzero(np.isnan(self.speed)):
            raise BusError(
                f"ESC {esc + 1} (node {self._nodes.first_esc + esc}) sends no Status: its speed is not known"
            )

    def silent_for(self, now: float) -> tuple[float, str]:
        """Time (s) since the ESC was heard that has been silent longest, and who that is."""
        if self._emulated:
            return now - self.heard_at, "the emulator"
        esc = int(np.argmin(self.status_at[: self._nodes.escs]))
        return now - float(self.status_at[esc]), f"ESC {esc + 1} (node {self._nodes.first_esc + esc})"

    def answer_age(self, now: float) -> float:
        """Time (s) since the command was sent that the last known speeds answer; NaN if it is not known."""
        if self.answered is None or self.answered >= len(self._sent_at):
            return np.nan
        return now - self._sent_at[-1 - self.answered]

    def _take(self, received: Received) -> None:
        message, now = received.message, self._link.now()
        match message:
            case RotorSpeeds(counts, command_id):
                self._count_gap("RotorSpeeds", received)
                self.speed = from_counts(counts, self._largest_speed)
                self.heard_at = now
                self.answers += 1
                self.answered = (self._command_id - command_id) % COMMAND_IDS
                self.late += self.answered > 0
            case Status(rpm=rpm, esc_index=index) if index == received.source - self._nodes.first_esc:
                self._count_gap("Status", received)
                self.present.add(received.source)
                self.rpm[index] = rpm
                self.status_at[index] = now
                self.lost["command"] = max(self.lost["command"], message.error_count if self._emulated else 0)
                if not self._emulated:
                    self.speed[index] = from_rpm((rpm,))[0]
            case NodeStatus(mode=mode) if mode == 0:
                self.present.add(received.source)

    def _count_gap(self, kind: str, received: Received) -> None:
        last = self._last_ids.get((kind, received.source))
        if last is not None:
            self.lost[kind] += (received.transfer_id - last - 1) % TRANSFER_IDS
        self._last_ids[kind, received.source] = received.transfer_id
