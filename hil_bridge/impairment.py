"""A bus that is not perfect: seeded loss, delay, jitter, duplication, reordering, bit flips and bus-off."""

from __future__ import annotations

import heapq
import random
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields

import can

from rotordx.hil_bridge.transfer import Header

_Entry = tuple[float, int, can.Message]  #: due (s), order of arrival, frame


@dataclass(frozen=True)
class Impairment:
    """What happens to each frame, in either direction, independently of the others."""

    loss: float = 0.0  #: probability
    delay: float = 0.0  #: s
    jitter: float = 0.0  #: s, largest additional delay, uniform
    duplicate: float = 0.0  #: probability of a second copy
    reorder: float = 0.0  #: probability of being held back until the next frame has passed
    flip: float = 0.0  #: probability of one wrong bit in the data, as if no CRC of CAN had noticed
    bus_off: float = float("inf")  #: s on the clock from which on nothing works any more
    seed: int = 0

    @classmethod
    def names(cls) -> list[str]:
        """Names of the options."""
        return [field.name for field in fields(cls)]


class ImpairedBus(can.BusABC):
    """One end of another bus, and what goes wrong between the two.

    Delayed frames move on whenever this end sends or receives.
    """

    def __init__(
        self,
        bus: can.BusABC,
        impairment: Impairment,
        clock: Callable[[], float] = time.monotonic,
        spared: Collection[int] = (),
        nodes: Collection[int] = (),
    ):
        """Wrap a bus, which is shut down with this one.

        Args:
            bus: a perfect one.
            impairment: see there.
            clock: s, for delays and bus-off; before 0 the bus is perfect.
            spared: DroneCAN data types that pass unharmed.
            nodes: ids of the nodes at this end, whose frames come back on some buses, and pass then.
        """
        self.lost = 0  #: frames dropped so far, in both directions
        self.channel_info = f"{bus.channel_info}, impaired"
        self._bus, self._impairment, self._clock, self._spared = bus, impairment, clock, frozenset(spared)
        self._nodes = frozenset(nodes)
        self._random = [random.Random(f"{impairment.seed} {direction}") for direction in ("out", "in")]
        self._waiting: tuple[list[_Entry], list[_Entry]] = ([], [])
        self._held: list[list[can.Message]] = [[], []]  # until the next frame has passed
        self._count = 0
        super().__init__(channel=bus.channel_info)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, or do to it what was asked for.

        Raises:
            can.CanOperationError: the bus is off.
        """
        self._check()
        self._impair(msg, 0)
        self._forward()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            self._check()
            self._forward()
            waiting = self._waiting[1]
            if waiting and waiting[0][0] <= self._clock():
                return heapq.heappop(waiting)[2], False
            left = 0.001 if end is None else end - time.monotonic()
            message = self._bus.recv(max(0.0, min(left, 0.001)) if any(self._waiting) else max(0.0, left))
            if message is not None:
                self._impair(message, 1)
            elif end is not None and time.monotonic() >= end:
                return None, False

    def shutdown(self) -> None:
        """Shut both down."""
        super().shutdown()
        self._bus.shutdown()

    def _check(self) -> None:
        if self._clock() >= self._impairment.bus_off:
            raise can.CanOperationError(f"{self.channel_info}: bus off")

    def _impair(self, message: can.Message, direction: int) -> None:
        """Put what is left of a frame, and its copies, in line."""
        rng, asked, now = self._random[direction], self._impairment, self._clock()
        header = Header.of(message.arbitration_id)
        if now < 0 or header.data_type in self._spared or (direction and header.source in self._nodes):
            self._put(message, direction, -float("inf"))
            return
        # All that is random is drawn for every frame, so that one probability does not change what another one hits.
        loss, duplicate, reorder, flip, jitter, place = (rng.random() for _ in range(6))
        if loss < asked.loss:
            self.lost += 1
            return
        if flip < asked.flip and message.data:
            bit = int(place * 8 * len(message.data))
            data = bytearray(message.data)
            data[bit // 8] ^= 1 << bit % 8
            message = can.Message(
                timestamp=message.timestamp,
                arbitration_id=message.arbitration_id,
                is_extended_id=message.is_extended_id,
                data=data,
                check=False,
            )
        due = now + asked.delay + asked.jitter * jitter if asked.delay or asked.jitter else -float("inf")
        copies = [message] * (2 if duplicate < asked.duplicate else 1)
        held, self._held[direction] = self._held[direction], []
        if reorder < asked.reorder and not held:
            self._held[direction] = copies
            return
        for copy in copies + held:
            self._put(copy, direction, due)

    def _put(self, message: can.Message, direction: int, due: float) -> None:
        self._count += 1
        heapq.heappush(self._waiting[direction], (due, self._count, message))

    def _forward(self) -> None:
        waiting = self._waiting[0]
        while waiting and waiting[0][0] <= self._clock():
            self._bus.send(heapq.heappop(waiting)[2])
