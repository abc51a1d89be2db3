"""CAN over UDP multicast in the packet format of ArduPilot and pydronecan, as an interface of python-can.

A packet is the magic number, CRC-16-CCITT of all that follows it, flags and CAN id (bit 31: 29-bit id), all
little-endian, then the data. Bus n is the group 239.65.82.n, port 57732. Unlike theirs, this end uses the loopback
interface and a time to live of 0 unless told otherwise: nothing leaves the machine.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from binascii import crc_hqx

import can

GROUP, PORT = "239.65.82", 57732
MAGIC, FLAG_FD, EXTENDED = 0x2934, 0x0001, 0x80000000
LARGEST_PACKET = 128
RECEIVE_BUFFER = 1 << 20  #: bytes

_HEADER, _BODY = struct.Struct("<HH"), struct.Struct("<HI")


class McastBus(can.BusABC):
    """One end of a multicast bus; it does not hear itself."""

    def __init__(
        self,
        channel: int | str = 0,
        can_filters: can.typechecking.CanFilters | None = None,
        interface_address: str = "127.0.0.1",
        time_to_live: int = 0,
        **_: object,
    ):
        """Join the group.

        Args:
            channel: number of the bus, 0 to 255.
            can_filters: see python-can.
            interface_address: of the network interface that carries the bus.
            time_to_live: 0: no packet leaves the machine.

        Raises:
            can.CanInitializationError: the machine refuses multicast there.
            ValueError: there is no such channel.
        """
        number = int(channel)
        if not 0 <= number <= 255:
            raise ValueError(f"the number of a multicast bus is 0 to 255, not {channel}")
        address = (f"{GROUP}.{number}", PORT)
        self.channel_info = f"mcast:{number}"
        self._receiver, self._sender = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        try:
            self._receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
            self._receiver.bind(address)
            interface = socket.inet_aton(interface_address)
            self._receiver.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(address[0]) + interface
            )
            self._receiver.setblocking(False)
            self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
            self._sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, time_to_live)
            self._sender.connect(address)
        except OSError as error:
            self._receiver.close()
            self._sender.close()
            raise can.CanInitializationError(f"{self.channel_info} on {interface_address}: {error.strerror}") from error
        self._own_address = self._sender.getsockname()
        super().__init__(channel=channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame.

        Raises:
            can.CanOperationError: the machine did not take it.
        """
        can_id = msg.arbitration_id | (EXTENDED if msg.is_extended_id else 0)
        body = _BODY.pack(FLAG_FD if msg.is_fd else 0, can_id) + msg.data
        try:
            self._sender.send(_HEADER.pack(MAGIC, crc_hqx(body, 0xFFFF)) + body)
        except OSError as error:
            raise can.CanOperationError(f"{self.channel_info}: {error.strerror}") from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Next frame of somebody else, (None, False) if there is none in time (s); packets in no such format pass."""
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            try:
                packet, sender = self._receiver.recvfrom(LARGEST_PACKET)
            except BlockingIOError:
                left = None if end is None else end - time.monotonic()
                if left is not None and left <= 0:
                    return None, False
                select.select([self._receiver], [], [], left)
                continue
            except OSError as error:
                raise can.CanOperationError(f"{self.channel_info}: {error.strerror}") from error
            message = None if sender == self._own_address else _message(packet)
            if message is not None:
                return message, False

    def fileno(self) -> int:
        """The receiving socket, for select."""
        return self._receiver.fileno()

    def shutdown(self) -> None:
        """Leave the group."""
        super().shutdown()
        self._receiver.close()
        self._sender.close()


def _message(packet: bytes) -> can.Message | None:
    """The frame in a packet, None if it is in another format or damaged."""
    if len(packet) < _HEADER.size + _BODY.size:
        return None
    magic, crc = _HEADER.unpack_from(packet)
    flags, can_id = _BODY.unpack_from(packet, _HEADER.size)
    data = packet[_HEADER.size + _BODY.size :]
    is_fd = bool(flags & FLAG_FD)
    if magic != MAGIC or crc != crc_hqx(packet[_HEADER.size :], 0xFFFF) or len(data) > (64 if is_fd else 8):
        return None
    return can.Message(
        timestamp=time.time(),
        arbitration_id=can_id & 0x1FFFFFFF,
        is_extended_id=bool(can_id & EXTENDED),
        is_fd=is_fd,
        data=data,
        check=False,
    )
