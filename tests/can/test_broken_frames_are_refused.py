"""Whatever arrives, the decoder does not raise, and gives no transfer with a wrong CRC, toggle or order."""

from __future__ import annotations

import random

import dronecan
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydronecan_oracle import what_they_read

from rotordx.hil_bridge.messages import MESSAGES, GetNodeInfo, RawCommand, Status
from rotordx.hil_bridge.transfer import (
    END,
    LARGEST_TRANSFER,
    START,
    TOGGLE,
    TRANSFER_TIMEOUT,
    Header,
    Reassembler,
    to_frames,
)

STATUS = Status(3, 15.9, 12.3, 310.0, 8123, 45, 2)
CAN_ID = Header(Status.DATA_TYPE, 42).can_id()


def accepted(frames, type_crc=Status.TYPE_CRC, reassembler=None, can_id=CAN_ID, now=0.0):
    """Payloads of the transfers that come out."""
    reassembler = reassembler or Reassembler()
    results = [reassembler.accept(can_id, frame, type_crc, now) for frame in frames]
    return [result[1] for result in results if result]


@given(st.sampled_from([*MESSAGES.values(), GetNodeInfo]), st.binary(max_size=400))
@settings(max_examples=3000, deadline=None, derandomize=True)
def test_decoding_never_raises(kind, payload):
    decoded = kind.decode(payload)
    assert decoded is None or isinstance(decoded.encode(), bytes)


def test_random_frames_never_raise_and_what_is_accepted_is_what_pydronecan_accepts():
    rng, agreed = random.Random(5), 0
    for _ in range(20_000):
        frames = to_frames(STATUS.encode(), rng.randrange(32), Status.TYPE_CRC)
        for _ in range(rng.randint(1, 2)):
            i = rng.randrange(len(frames))
            kind = rng.randrange(4)
            if not frames[i]:
                continue
            if kind == 0:  # a bit flips
                data = bytearray(frames[i])
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
                frames[i] = bytes(data)
            elif kind == 1:  # a frame is lost
                del frames[i]
            elif kind == 2:  # a frame is shortened
                frames[i] = frames[i][: rng.randrange(len(frames[i]) + 1)]
            else:  # two frames change places
                j = rng.randrange(len(frames))
                frames[i], frames[j] = frames[j], frames[i]
            if not frames:
                break
        for payload in accepted(frames):
            try:
                theirs = what_they_read([(CAN_ID, frame) for frame in frames])
            except (dronecan.transport.TransferError, IndexError):
                # Ours looks at a stream: a single frame among the rest may be a transfer of its own.
                assert len(payload) <= 7
                assert any(frame[:-1] == payload and frame[-1] & (START | END) == START | END for frame in frames)
            else:
                agreed += 1
                assert Status.decode(payload) is not None or len(payload) != len(STATUS.encode())
                assert theirs is not None
    assert agreed > 100  # undone mutations: the test compares something


@pytest.mark.parametrize("bit", range(8 * 19))
def test_every_flipped_bit_of_a_status_is_noticed(bit):
    """19 bytes on the wire. A flip in a tail byte breaks start, end, toggle or transfer id; any other one the CRC."""
    frames = [bytearray(frame) for frame in to_frames(STATUS.encode(), 7, Status.TYPE_CRC)]
    place = bit // 8
    frames[place // 8][place % 8] ^= 1 << bit % 8
    payloads = accepted([bytes(frame) for frame in frames])
    assert all(len(payload) <= 7 for payload in payloads)  # a tail byte may turn one frame into a transfer of its own
    assert all(Status.decode(payload) is None for payload in payloads)


def test_crc_of_another_data_type_is_refused():
    frames = to_frames(STATUS.encode(), 0, RawCommand.TYPE_CRC)
    reassembler = Reassembler()
    assert accepted(frames, reassembler=reassembler) == []
    assert reassembler.broken == 1


def test_every_toggle_bit_counts():
    for i in range(3):
        frames = [bytearray(frame) for frame in to_frames(STATUS.encode(), 0, Status.TYPE_CRC)]
        frames[i][-1] ^= TOGGLE
        assert accepted([bytes(frame) for frame in frames]) == []


def test_a_transfer_of_more_than_its_time_is_refused():
    first, *rest = to_frames(STATUS.encode(), 0, Status.TYPE_CRC)
    reassembler = Reassembler()
    accepted([first], reassembler=reassembler)
    assert accepted(rest, reassembler=reassembler, now=TRANSFER_TIMEOUT + 0.001) == []
    accepted([first], reassembler=reassembler, now=10.0)
    assert accepted(rest, reassembler=reassembler, now=10.0 + TRANSFER_TIMEOUT) == [STATUS.encode()]


def test_a_jump_of_the_clock_breaks_no_transfer():
    first, *rest = to_frames(STATUS.encode(), 0, Status.TYPE_CRC)
    reassembler = Reassembler()
    accepted([first], reassembler=reassembler, now=-1e6)
    reassembler.restart(0.0)
    assert accepted(rest, reassembler=reassembler, now=0.001) == [STATUS.encode()]
    assert reassembler.broken == 0


def test_senders_do_not_disturb_each_other():
    """Frames of two nodes alternate on the bus."""
    reassembler, payloads = Reassembler(), []
    ours, theirs = (to_frames(STATUS.encode(), i, Status.TYPE_CRC) for i in (4, 9))
    for a, b in zip(ours, theirs, strict=True):
        for node, frame in ((1, a), (2, b)):
            payloads += accepted([frame], reassembler=reassembler, can_id=Header(Status.DATA_TYPE, node).can_id())
    assert payloads == [STATUS.encode()] * 2


def test_repeated_and_overtaken_transfers_are_stale():
    reassembler = Reassembler()

    def command(transfer_id: int, now: float = 0.0) -> bool:
        frames = to_frames(RawCommand((1, 2, 3, 4)).encode(), transfer_id, RawCommand.TYPE_CRC)
        return bool(accepted(frames, RawCommand.TYPE_CRC, reassembler, Header(1030, 10).can_id(), now))

    assert [command(i) for i in (30, 30, 31, 0, 31, 2, 1, 3)] == [True, False, True, True, False, True, False, True]
    assert reassembler.stale == 3
    assert command(20) is False  # 17 ahead is 15 behind
    assert command(19) is True  # 16 ahead
    assert command(19, TRANSFER_TIMEOUT) is True  # a sender that has restarted


def test_endless_transfers_do_not_pile_up():
    reassembler, tail = Reassembler(), START
    for _ in range(LARGEST_TRANSFER):
        assert reassembler.accept(CAN_ID, bytes(7) + bytes((tail,)), Status.TYPE_CRC, 0.0) is None
        tail = (tail ^ TOGGLE) & ~START
    assert reassembler.broken > 0


@given(st.integers(0, 2**29 - 1), st.lists(st.binary(max_size=8), max_size=12))
@settings(max_examples=2000, deadline=None, derandomize=True)
def test_arbitrary_frames_never_raise(can_id, frames):
    reassembler = Reassembler()
    for frame in frames:
        header = Header.of(can_id)
        assert 0 <= header.source <= 127
        reassembler.accept(can_id, frame, Status.TYPE_CRC, 0.0)
