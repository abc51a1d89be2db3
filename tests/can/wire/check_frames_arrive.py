"""Frames cross the bus whole, in order and in both directions."""

from __future__ import annotations

import socket
import struct
from binascii import crc_hqx

import can
import pytest

from rotordx.hil_bridge.buses import BusAddress, open_bus
from rotordx.hil_bridge.mcast import GROUP, PORT

FRAMES = 1000


def test_every_frame_in_order(bus):
    address = BusAddress.of(bus)
    with open_bus(address) as a, open_bus(address) as b:
        for sender, receiver in ((a, b), (b, a)):
            for i in range(FRAMES):
                extended = bool(i % 2)
                sent = can.Message(
                    arbitration_id=i * 104729 % (1 << 29 if extended else 1 << 11),
                    is_extended_id=extended,
                    data=i.to_bytes(4, "big") * 2 if i % 3 else b"",
                )
                sender.send(sent)
                received = receiver.recv(5.0)
                assert received.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
                if bus.startswith("udp_multicast"):  # here an end hears itself
                    assert sender.recv(5.0).arbitration_id == sent.arbitration_id
        assert a.recv(0) is None
        assert b.recv(0) is None


@pytest.fixture
def raw_sender():
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    yield lambda packet: sender.sendto(packet, (f"{GROUP}.7", PORT))
    sender.close()


def packet(data: bytes, flags: int = 0, magic: int = 0x2934) -> bytes:
    body = struct.pack("<HI", flags, 0x80000005) + data
    return struct.pack("<HH", magic, crc_hqx(body, 0xFFFF)) + body


def test_packets_in_another_format_are_no_frames(raw_sender):
    good = packet(b"good")
    with open_bus(BusAddress.of("mcast:7")) as bus:
        for broken in (
            b"",
            good[:9],
            packet(b"magic", magic=0x2935),
            good[:-1] + b"D",
            good + b"x",
            packet(b"nine bytes"[:9]),
            bytes(128),
        ):
            raw_sender(broken)
        raw_sender(good)
        raw_sender(packet(b"more than eight bytes", flags=1))
        assert bytes(bus.recv(5.0).data) == b"good"
        assert bus.recv(5.0).is_fd
        assert bus.recv(0) is None


def test_multicast_stays_on_the_machine():
    with open_bus(BusAddress.of("mcast:7")) as bus:
        assert bus._sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        assert bus._own_address[0] == "127.0.0.1"
