"""What goes wrong on an impaired bus is what was asked for, and the same with the same seed."""

from __future__ import annotations

import itertools

import can
import pytest

from rotordx.hil_bridge.buses import BusAddress, BusError, open_bus
from rotordx.hil_bridge.link import Link
from rotordx.hil_bridge.messages import LOCKSTEP_TYPES, NodeStatus, StepRequest
from rotordx.hil_bridge.transfer import Header

FRAMES = 4000
channels = itertools.count()


def received(options: str, direction: str = "in", clock=lambda: 0.0) -> list[int]:
    """Numbers of the frames, sent in order, that arrive at the other end."""
    channel = f"impaired {next(channels)}"
    perfect = open_bus(BusAddress.of(f"virtual:{channel}"))
    impaired = open_bus(BusAddress.of(f"virtual:{channel}?{options}"), clock, LOCKSTEP_TYPES)
    sender, receiver = (perfect, impaired) if direction == "in" else (impaired, perfect)
    numbers = []
    with perfect, impaired:
        for i in range(FRAMES):
            sender.send(can.Message(arbitration_id=Header(341, 1).can_id(), data=i.to_bytes(4, "big")))
            while (message := receiver.recv(0)) is not None:
                numbers.append(int.from_bytes(message.data, "big"))
    return numbers


@pytest.mark.parametrize("direction", ["in", "out"])
def test_loss(direction):
    arrived = received("loss=0.2&seed=3", direction)
    assert arrived == sorted(set(arrived))
    assert len(arrived) == pytest.approx(0.8 * FRAMES, abs=4 * (FRAMES * 0.2 * 0.8) ** 0.5)


def test_duplication():
    arrived = received("duplicate=0.3")
    assert arrived == sorted(arrived)
    assert set(arrived) == set(range(FRAMES))
    assert len(arrived) == pytest.approx(1.3 * FRAMES, abs=4 * (FRAMES * 0.3 * 0.7) ** 0.5)


def test_reordering_lets_the_next_frame_pass():
    arrived = received("reorder=0.1")
    assert set(arrived) >= set(range(FRAMES - 1))
    late = [a for a, b in itertools.pairwise(arrived) if b < a]
    assert all(b == a - 1 for a, b in itertools.pairwise(arrived) if b < a)
    assert len(late) == pytest.approx(FRAMES * 0.1 / 1.1, rel=0.2)


def test_one_bit_of_a_frame_flips():
    arrived = received("flip=0.25")
    assert len(arrived) == FRAMES
    wrong = [(i, value) for i, value in enumerate(arrived) if value != i]
    assert all((i ^ value).bit_count() == 1 for i, value in wrong)
    assert len(wrong) == pytest.approx(0.25 * FRAMES, abs=4 * (FRAMES * 0.25 * 0.75) ** 0.5)
    assert len({i ^ value for i, value in wrong}) == 32  # every bit is hit sometimes


def test_delay_and_jitter_on_the_clock_that_was_given():
    now = 0.0
    bus = open_bus(BusAddress.of("virtual:delayed?delay=0.010&jitter=0.004&seed=1"), lambda: now)
    delays = []
    with bus, open_bus(BusAddress.of("virtual:delayed")) as other:
        for i in range(300):
            sent_at = now = 10.0 * i
            other.send(can.Message(arbitration_id=5, data=b"x"))
            while bus.recv(0) is None:
                now += 0.0005
            delays.append(now - sent_at)
    assert 0.010 <= min(delays) < 0.011
    assert 0.0135 < max(delays) <= 0.0145


@pytest.mark.parametrize("options", ["loss=0.3", "loss=0.1&duplicate=0.2&reorder=0.2&flip=0.1"])
def test_same_seed_same_frames(options):
    assert received(f"{options}&seed=7") == received(f"{options}&seed=7")
    assert received(f"{options}&seed=7") != received(f"{options}&seed=8")


def test_directions_and_kinds_are_independent():
    """More of one kind does not change which frames another kind hits."""
    lost = set(range(FRAMES)) - set(received("loss=0.2&seed=3"))
    assert lost != set(range(FRAMES)) - set(received("loss=0.2&seed=3", "out"))
    assert lost == set(range(FRAMES)) - set(received("loss=0.2&duplicate=0.5&seed=3"))


def test_the_clock_of_lock_step_is_spared():
    clean = open_bus(BusAddress.of("virtual:spared"))
    impaired = open_bus(BusAddress.of("virtual:spared?loss=1"), spared=LOCKSTEP_TYPES)
    with clean, impaired:
        link = Link(impaired, {1: "one"}, {})
        link.send(1, NodeStatus(0))
        link.send(1, StepRequest(3))
        assert Header.of(clean.recv(1).arbitration_id).data_type == StepRequest.DATA_TYPE
        assert clean.recv(0) is None


def test_bus_off_at_its_time():
    now = 0.0
    link = Link(open_bus(BusAddress.of("virtual:off?bus_off=2.5"), lambda: now), {1: "one"}, {})
    link.send(1, NodeStatus(0))
    assert link.receive() is None
    now = 2.5
    with pytest.raises(BusError, match=r"the bus is lost: .*bus off"):
        link.send(1, NodeStatus(0))
    with pytest.raises(BusError, match=r"the bus is lost: .*bus off"):
        link.receive()
    link.close()
