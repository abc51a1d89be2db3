"""Our DroneCAN messages are pydronecan's, byte by byte, in both directions."""

from __future__ import annotations

import math
import random

import pytest
from pydronecan_oracle import CASES, their_frames, what_they_read

from rotordx.hil_bridge.messages import GetNodeInfo
from rotordx.hil_bridge.transfer import Header, Reassembler, to_frames

MESSAGES = 10_000  #: random ones of each type
SOURCE, DESTINATION = 42, 10


def same(a, b) -> bool:
    """Equality in which NaN equals NaN."""
    return all(
        x == y or (isinstance(x, float) and math.isnan(x) and math.isnan(y))
        for x, y in ((getattr(a, name), getattr(b, name)) for name in type(a).__slots__)
    )


@pytest.mark.parametrize("name", CASES)
def test_frames_and_values_are_equal(name):
    case, rng, reassembler = CASES[name], random.Random(name), Reassembler()
    for i in range(MESSAGES):
        ours = case.random(rng)
        kind = type(ours)
        service = {"destination": DESTINATION, "is_service": True} if kind is GetNodeInfo else {}
        header = Header(kind.DATA_TYPE, SOURCE, priority=rng.randrange(32), **service)
        frames = [(header.can_id(), data) for data in to_frames(ours.encode(), i % 32, kind.TYPE_CRC)]
        assert frames == their_frames(
            case.theirs(ours),
            source=SOURCE,
            transfer_id=i % 32,
            priority=header.priority,
            destination=service.get("destination"),
        ), ours

        assert Header.of(frames[0][0]) == header
        received = [reassembler.accept(can_id, data, kind.TYPE_CRC, 10.0 * i) for can_id, data in frames]
        assert received[:-1] == [None] * (len(frames) - 1)
        transfer_id, payload = received[-1]
        assert transfer_id == i % 32
        decoded = kind.decode(payload)
        assert decoded.encode() == ours.encode()
        assert same(decoded, case.ours(what_they_read(frames))), ours
