"""Nodes' view of a bus: messages in, messages out, and only from those who are expected."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import NamedTuple

import can

from rotordx.hil_bridge.buses import BusError
from rotordx.hil_bridge.messages import LOCKSTEP_TYPES, MESSAGES, GetNodeInfo, Message, NodeStatus
from rotordx.hil_bridge.transfer import BROADCAST, TRANSFER_IDS, Header, Reassembler, to_frames

DRAINED = 1000  #: messages taken in one go


class Received(NamedTuple):
    """A message, where it came from, and the transfer id that its sender gave it."""

    source: int
    transfer_id: int
    message: Message


class Link:
    """One end of a bus, on which one or more nodes of this process live.

    Everything that was not expected (other nodes, other types, 11-bit ids, remote and error frames) is counted and
    passes by; GetNodeInfo is answered.
    """

    def __init__(
        self,
        bus: can.BusABC,
        nodes: Mapping[int, str],
        expected: Mapping[type[Message], Collection[int]],
        clock: Callable[[], float] = time.monotonic,
    ):
        """Take over one end of a bus, which is shut down with the link.

        Args:
            bus: the end.
            nodes: node id -> name, of the nodes that live here.
            expected: message -> the nodes that it is accepted from.
            clock: s, the age of transfers.
        """
        self.bus = bus
        self.nodes = dict(nodes)
        self.foreign = 0  #: frames from others than expected
        self.frames: Counter[int] = Counter()  #: data bytes -> frames of that length, sent and received
        self.now = clock  #: s
        self._expected = {message.DATA_TYPE: frozenset(sources) for message, sources in expected.items()}
        self._reassembler = Reassembler()
        self._transfer_ids: Counter[tuple[int, int, int]] = Counter()
        self._began = time.monotonic()

    def forget(self) -> None:
        """Count from here on; the clock may have jumped."""
        self.foreign = 0
        self.frames.clear()
        self._reassembler.restart(self.now())

    @property
    def stale(self) -> int:
        """Transfers dropped because they were repeated or late."""
        return self._reassembler.stale

    @property
    def broken(self) -> int:
        """Transfers dropped because they were damaged."""
        return self._reassembler.broken

    @property
    def uptime(self) -> int:
        """Whole seconds since the link was made."""
        return int(time.monotonic() - self._began)

    def send(self, node: int, message: Message) -> int:
        """Broadcast a message of one of our nodes; its transfer id.

        Raises:
            BusError: the bus did not take it.
        """
        key = (message.DATA_TYPE, node, BROADCAST)
        transfer_id = self._transfer_ids[key] % TRANSFER_IDS
        self._transfer_ids[key] += 1
        self._send(Header(message.DATA_TYPE, node, priority=message.PRIORITY), message, transfer_id)
        return transfer_id

    def receive(self, timeout: float = 0.0) -> Received | None:
        """Next expected message; None if there is none in time (s).

        Raises:
            BusError: the bus does not work any more.
        """
        end = time.monotonic() + timeout if timeout else 0.0
        while True:
            try:
                frame = self.bus.recv(timeout)
            except (can.CanError, OSError) as error:
                raise BusError(f"the bus is lost: {error}") from error
            received = None if frame is None else self._accept(frame)
            if received is not None:
                return received
            if timeout:
                timeout = max(0.0, end - time.monotonic())
            if frame is None and not timeout:
                return None

    def drain(self) -> Iterator[Received]:
        """Messages that have arrived, but no more than `DRAINED`: senders may be faster than we are.

        Raises:
            BusError: the bus does not work any more.
        """
        for _ in range(DRAINED):
            received = self.receive()
            if received is None:
                return
            yield received

    def close(self) -> None:
        """Shut the bus down."""
        self.bus.shutdown()

    def _accept(self, frame: can.Message) -> Received | None:
        data = bytes(frame.data)
        if not frame.is_extended_id or frame.is_error_frame or frame.is_remote_frame or frame.is_fd:
            self.foreign += 1
            return None
        can_id = frame.arbitration_id
        header = Header.of(can_id)
        if header.source in self.nodes:
            return None  # some buses let an end hear itself
        self._count(header, len(data))
        if header.is_service:
            self._serve(header, data)
            return None
        if header.source not in self._expected.get(header.data_type, ()):
            self.foreign += 1
            return None
        kind = MESSAGES[header.data_type]
        transfer = self._reassembler.accept(can_id, data, kind.TYPE_CRC, self.now())
        if transfer is None:
            return None
        message = kind.decode(transfer[1])
        return None if message is None else Received(header.source, transfer[0], message)

    def _count(self, header: Header, length: int) -> None:
        """Count a frame towards the load, unless it is there for the simulation only."""
        if header.data_type not in LOCKSTEP_TYPES:
            self.frames[length] += 1

    def _serve(self, header: Header, data: bytes) -> None:
        """Answer a request of GetNodeInfo, an empty frame."""
        name = self.nodes.get(header.destination)
        if not header.is_request or header.data_type != GetNodeInfo.DATA_TYPE or name is None or len(data) != 1:
            return
        unique_id = name.encode("ascii")[-15:].rjust(15, b"\0") + bytes((header.destination,))
        info = GetNodeInfo(NodeStatus(self.uptime), name, software_version=(0, 1), unique_id=unique_id)
        answer = Header(
            GetNodeInfo.DATA_TYPE, header.destination, header.source, is_service=True, priority=header.priority
        )
        self._send(answer, info, data[-1] % TRANSFER_IDS)

    def _send(self, header: Header, message: Message, transfer_id: int) -> None:
        can_id = header.can_id()
        try:
            for data in to_frames(message.encode(), transfer_id, message.TYPE_CRC):
                self._count(header, len(data))
                self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=True, check=False))
        except (can.CanError, OSError) as error:
            raise BusError(f"the bus is lost: {error}") from error
