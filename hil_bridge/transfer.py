"""DroneCAN transfers: how a payload becomes CAN 2.0B frames, and how frames become payloads again.

Layouts are those of the DroneCAN specification, section "CAN bus transport layer". The last byte of every frame, the
tail byte, is start of transfer, end of transfer, toggle, and 5 bits of transfer id.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from typing import NamedTuple

START, END, TOGGLE, TRANSFER_ID = 0x80, 0x40, 0x20, 0x1F
TRANSFER_IDS = 32  #: transfer ids count modulo this
TRANSFER_TIMEOUT = 2.0  #: s after which a sender may have restarted: any transfer id is then new
FRAME_PAYLOAD = 7  #: bytes of a frame before its tail byte
LARGEST_TRANSFER = 512  #: bytes; more than any type here needs, so that garbage does not pile up
BROADCAST = 0  #: destination of messages; no node has this id
LARGEST_NODE = 127


class Header(NamedTuple):
    """What a 29-bit CAN id says."""

    data_type: int
    source: int
    destination: int = BROADCAST  #: a node for services, BROADCAST for messages
    is_service: bool = False
    is_request: bool = False
    priority: int = 16  #: 0 (first) to 31 (last)

    def can_id(self) -> int:
        """The CAN id."""
        if self.is_service:
            middle = self.data_type << 16 | self.is_request << 15 | self.destination << 8 | 0x80
        else:
            middle = self.data_type << 8
        return self.priority << 24 | middle | self.source

    @classmethod
    def of(cls, can_id: int) -> Header:
        """What a CAN id says; the data type of an anonymous message (source 0) is not known."""
        priority, source = can_id >> 24 & 0x1F, can_id & 0x7F
        if can_id & 0x80:
            destination, is_request = can_id >> 8 & 0x7F, bool(can_id & 0x8000)
            return cls(can_id >> 16 & 0xFF, source, destination, True, is_request, priority)
        return cls(can_id >> 8 & 0xFFFF, source, priority=priority)


def signature_crc(signature: int) -> int:
    """CRC-16-CCITT of a data type's signature, with which the CRC of every transfer of that type starts."""
    return crc_hqx(struct.pack("<Q", signature), 0xFFFF)


def to_frames(payload: bytes, transfer_id: int, type_crc: int) -> list[bytes]:
    """Frame contents, tail byte included: one frame, or several that start with the CRC of the payload."""
    if len(payload) <= FRAME_PAYLOAD:
        return [payload + bytes((START | END | transfer_id,))]
    content = crc_hqx(payload, type_crc).to_bytes(2, "little") + payload
    frames, tail = [], START | transfer_id
    for first in range(0, len(content), FRAME_PAYLOAD):
        if first + FRAME_PAYLOAD >= len(content):
            tail |= END
        frames.append(content[first : first + FRAME_PAYLOAD] + bytes((tail,)))
        tail = (tail ^ TOGGLE) & ~START
    return frames


class _Session:
    """Where the transfers of one CAN id stand."""

    __slots__ = ("accepted", "accepted_at", "content", "started_at", "toggle", "transfer_id")

    def __init__(self) -> None:
        self.accepted = -1  # transfer id of the last whole transfer
        self.accepted_at = 0.0
        self.content: bytearray | None = None  # of the transfer under way
        self.started_at = 0.0
        self.toggle = 0
        self.transfer_id = 0


class Reassembler:
    """Puts the frames of many senders together; gives every whole, new transfer once.

    Stale ones (repeated, or overtaken by a later transfer of the same sender and type) are dropped and counted, as are
    broken ones: wrong CRC, wrong toggle bit, missing start, too long.
    """

    def __init__(self) -> None:
        self.stale = 0
        self.broken = 0
        self._sessions: dict[int, _Session] = {}

    def restart(self, now: float) -> None:
        """Count from here on, and take this instant (s), from which the clock may be another one, for the last."""
        self.stale = self.broken = 0
        for session in self._sessions.values():
            session.accepted_at = session.started_at = now

    def accept(self, can_id: int, data: bytes, type_crc: int, now: float) -> tuple[int, bytes] | None:
        """Transfer id and payload if this frame completes a transfer.

        Args:
            can_id: 29 bits.
            data: of the frame, with its tail byte.
            type_crc: `signature_crc` of the data type.
            now: s on any clock that does not go back.
        """
        if not data:
            self.broken += 1
            return None
        session = self._sessions.get(can_id)
        if session is None:
            session = self._sessions[can_id] = _Session()
        tail = data[-1]
        if tail & START:
            return self._start(session, tail, data, now, ordered=not can_id & 0x80)
        return self._go_on(session, tail, data, type_crc, now)

    def _start(self, session: _Session, tail: int, data: bytes, now: float, ordered: bool) -> tuple[int, bytes] | None:
        """First frame of a transfer; messages keep an order, while service calls of a node may cross each other."""
        transfer_id = tail & TRANSFER_ID
        session.content = None
        if tail & TOGGLE or (not tail & END and len(data) != FRAME_PAYLOAD + 1):
            self.broken += 1
            return None
        if session.accepted >= 0 and now - session.accepted_at < TRANSFER_TIMEOUT:
            ahead = (transfer_id - session.accepted) % TRANSFER_IDS
            if ahead == 0 or (ordered and ahead > TRANSFER_IDS // 2):
                self.stale += 1
                return None
        if tail & END:
            session.accepted, session.accepted_at = transfer_id, now
            return transfer_id, data[:-1]
        session.content = bytearray(data[:-1])
        session.toggle, session.transfer_id, session.started_at = TOGGLE, transfer_id, now
        return None

    def _go_on(self, session: _Session, tail: int, data: bytes, type_crc: int, now: float) -> tuple[int, bytes] | None:
        content = session.content
        if content is None:
            self.broken += 1
            return None
        content += data[:-1]
        fits = len(data) == FRAME_PAYLOAD + 1 or tail & END
        if (
            tail & (TOGGLE | TRANSFER_ID) != session.toggle | session.transfer_id
            or now - session.started_at > TRANSFER_TIMEOUT
            or not fits
            or len(content) > LARGEST_TRANSFER
        ):
            session.content = None
            self.broken += 1
            return None
        session.toggle ^= TOGGLE
        if not tail & END:
            return None
        session.content = None
        payload = bytes(content[2:])
        if crc_hqx(payload, type_crc) != content[0] | content[1] << 8:
            self.broken += 1
            return None
        session.accepted, session.accepted_at = session.transfer_id, now
        return session.transfer_id, payload
