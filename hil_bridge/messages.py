"""DroneCAN data types of speed controllers, each with its payload: standard ones, and four of this project's own.

Numbers out of a field's range saturate, as the specification asks for.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

from rotordx.hil_bridge.packing import halves, pack_array, saturated, signed, swapped, unpack_array, unswapped
from rotordx.hil_bridge.transfer import signature_crc

RAW_FULL_SCALE = 8191  #: RawCommand of the largest rotor speed


class Message(Protocol):
    """A value of a data type; `decode` gives None for what is no payload of it and never raises."""

    DATA_TYPE: ClassVar[int]
    TYPE_CRC: ClassVar[int]
    PRIORITY: ClassVar[int]

    def encode(self) -> bytes:
        """The payload."""

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""


@dataclass(slots=True)
class RawCommand:
    """Setpoints of all ESCs, -8192 to 8191; 8191 is full speed (uavcan.equipment.esc.RawCommand)."""

    DATA_TYPE: ClassVar[int] = 1030
    TYPE_CRC: ClassVar[int] = signature_crc(0x217F5C87D7EC951D)
    PRIORITY: ClassVar[int] = 5

    setpoints: tuple[int, ...]

    def encode(self) -> bytes:
        """The payload."""
        return pack_array(self.setpoints, 14)

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        values = unpack_array(payload, 14)
        return None if values is None else cls(values)


@dataclass(slots=True)
class RPMCommand:
    """Rotor speeds that all ESCs are to hold, 1/min (uavcan.equipment.esc.RPMCommand)."""

    DATA_TYPE: ClassVar[int] = 1031
    TYPE_CRC: ClassVar[int] = signature_crc(0xCE0F9F621CF7E70B)
    PRIORITY: ClassVar[int] = 5

    rpm: tuple[int, ...]

    def encode(self) -> bytes:
        """The payload."""
        return pack_array(self.rpm, 18)

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        values = unpack_array(payload, 18)
        return None if values is None else cls(values)


@dataclass(slots=True)
class Status:
    """State of one ESC (uavcan.equipment.esc.Status); NaN is unknown."""

    DATA_TYPE: ClassVar[int] = 1034
    TYPE_CRC: ClassVar[int] = signature_crc(0xA9AF28AEA2FBB254)
    PRIORITY: ClassVar[int] = 7

    error_count: int
    voltage: float  #: V
    current: float  #: A
    temperature: float  #: K
    rpm: int  #: 1/min
    power_rating_percent: int
    esc_index: int  #: from 0

    def encode(self) -> bytes:
        """The payload."""
        rpm = swapped(saturated(self.rpm, -(1 << 17), (1 << 17) - 1), 18)
        power, index = saturated(self.power_rating_percent, 0, 127), saturated(self.esc_index, 0, 31)
        return (
            saturated(self.error_count, 0, 0xFFFFFFFF).to_bytes(4, "little")
            + halves((self.voltage, self.current, self.temperature))
            + (rpm << 14 | power << 7 | index << 2).to_bytes(4, "big")
        )

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        if len(payload) != 14:
            return None
        errors, voltage, current, temperature = struct.unpack_from("<Ieee", payload)
        bits = int.from_bytes(payload[10:], "big")
        rpm = signed(unswapped(bits >> 14, 18), 18)
        return cls(errors, voltage, current, temperature, rpm, bits >> 7 & 0x7F, bits >> 2 & 0x1F)


@dataclass(slots=True)
class StatusExtended:
    """More about one ESC, less often (uavcan.equipment.esc.StatusExtended)."""

    DATA_TYPE: ClassVar[int] = 1036
    TYPE_CRC: ClassVar[int] = signature_crc(0x2DC203C50960EDC)
    PRIORITY: ClassVar[int] = 20

    input_percent: int
    output_percent: int
    motor_temperature: int  #: degC
    motor_angle: int  #: deg
    status_flags: int
    esc_index: int  #: from 0

    def encode(self) -> bytes:
        """The payload."""
        bits = saturated(self.input_percent, 0, 127) << 7 | saturated(self.output_percent, 0, 127)
        bits = bits << 9 | swapped(saturated(self.motor_temperature, -256, 255), 9)
        bits = bits << 9 | swapped(saturated(self.motor_angle, 0, 511), 9)
        bits = bits << 19 | swapped(saturated(self.status_flags, 0, (1 << 19) - 1), 19)
        return (bits << 5 | saturated(self.esc_index, 0, 31)).to_bytes(7, "big")

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        if len(payload) != 7:
            return None
        bits = int.from_bytes(payload, "big")
        return cls(
            bits >> 49,
            bits >> 42 & 0x7F,
            signed(unswapped(bits >> 33 & 0x1FF, 9), 9),
            unswapped(bits >> 24 & 0x1FF, 9),
            unswapped(bits >> 5 & 0x7FFFF, 19),
            bits & 0x1F,
        )


@dataclass(slots=True)
class NodeStatus:
    """Sign of life of a node, once a second (uavcan.protocol.NodeStatus)."""

    DATA_TYPE: ClassVar[int] = 341
    TYPE_CRC: ClassVar[int] = signature_crc(0xF0868D0C1A7C6F1)
    PRIORITY: ClassVar[int] = 30

    uptime: int  #: s
    health: int = 0  #: 0 ok, 1 warning, 2 error, 3 critical
    mode: int = 0  #: 0 operational, 1 initialisation, 2 maintenance, 3 software update, 7 offline
    sub_mode: int = 0
    vendor_code: int = 0

    def encode(self) -> bytes:
        """The payload."""
        state = saturated(self.health, 0, 3) << 6 | saturated(self.mode, 0, 7) << 3 | saturated(self.sub_mode, 0, 7)
        return struct.pack("<IBH", saturated(self.uptime, 0, 0xFFFFFFFF), state, saturated(self.vendor_code, 0, 0xFFFF))

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        if len(payload) != 7:
            return None
        uptime, state, code = struct.unpack("<IBH", payload)
        return cls(uptime, state >> 6, state >> 3 & 7, state & 7, code)


@dataclass(slots=True)
class ArmingStatus:
    """Whether motors may turn: 0 disarmed, 255 fully armed (uavcan.equipment.safety.ArmingStatus)."""

    DATA_TYPE: ClassVar[int] = 1100
    TYPE_CRC: ClassVar[int] = signature_crc(0x8700F375556A8003)
    PRIORITY: ClassVar[int] = 15
    DISARMED: ClassVar[int] = 0
    FULLY_ARMED: ClassVar[int] = 255

    status: int

    def encode(self) -> bytes:
        """The payload."""
        return bytes((saturated(self.status, 0, 255),))

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        return cls(payload[0]) if len(payload) == 1 else None


@dataclass(slots=True)
class GetNodeInfo:
    """What a node is (response of the service uavcan.protocol.GetNodeInfo; the request is empty)."""

    DATA_TYPE: ClassVar[int] = 1
    TYPE_CRC: ClassVar[int] = signature_crc(0xEE468A8121C46A9E)
    PRIORITY: ClassVar[int] = 30

    status: NodeStatus
    name: str  #: reversed domain name, up to 80 ASCII characters
    software_version: tuple[int, int] = (0, 0)
    optional_fields: int = 0  #: 1: vcs_commit is set, 2: image_crc is
    vcs_commit: int = 0
    image_crc: int = 0
    hardware_version: tuple[int, int] = (0, 0)
    unique_id: bytes = bytes(16)
    certificate: bytes = b""

    def encode(self) -> bytes:
        """The payload."""
        return (
            self.status.encode()
            + struct.pack("<BBBIQ", *self.software_version, self.optional_fields, self.vcs_commit, self.image_crc)
            + struct.pack("<BB16sB", *self.hardware_version, self.unique_id, len(self.certificate))
            + self.certificate
            + self.name.encode("ascii")[:80]
        )

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        end = 41 + payload[40] if len(payload) > 40 else 0
        status = NodeStatus.decode(payload[:7])
        if status is None or not 41 <= end <= len(payload) <= end + 80:
            return None
        major, minor, fields, commit, crc = struct.unpack_from("<BBBIQ", payload, 7)
        hardware = payload[22], payload[23]
        name = payload[end:].decode("ascii", errors="replace")
        return cls(status, name, (major, minor), fields, commit, crc, hardware, payload[24:40], payload[41:end])


@dataclass(slots=True)
class RotorSpeeds:
    """Own type: speeds of the four rotors of an emulator after every one of its steps, in one frame.

    13 bits each, 8191 being the largest rotor speed as in RawCommand, and 4 bits of the transfer id of the command
    that the step worked with, so that the receiver knows how old what it sees is.
    """

    DATA_TYPE: ClassVar[int] = 20740
    TYPE_CRC: ClassVar[int] = signature_crc(0)  # one frame has no CRC
    PRIORITY: ClassVar[int] = 6

    counts: tuple[int, int, int, int]  #: 0 to 8191
    command_id: int  #: transfer id of the command, modulo 16

    def encode(self) -> bytes:
        """The payload."""
        bits = 0
        for count in self.counts:
            bits = bits << 13 | saturated(count, 0, RAW_FULL_SCALE)
        return (bits << 4 | self.command_id & 0xF).to_bytes(7, "big")

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        if len(payload) != 7:
            return None
        bits = int.from_bytes(payload, "big")
        counts = bits >> 43, bits >> 30 & 0x1FFF, bits >> 17 & 0x1FFF, bits >> 4 & 0x1FFF
        return cls(counts, bits & 0xF)


@dataclass(slots=True)
class SpeedsRequest:
    """Own type: from now on until the ESCs are disarmed, RotorSpeeds is wanted; tools that do not know it get none."""

    DATA_TYPE: ClassVar[int] = 20743
    TYPE_CRC: ClassVar[int] = signature_crc(0)
    PRIORITY: ClassVar[int] = 15

    def encode(self) -> bytes:
        """The payload, which is empty."""
        return b""

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        return None if payload else cls()


@dataclass(slots=True)
class StepRequest:
    """Own type: in lock step, the emulator is to make this step with what has reached it."""

    DATA_TYPE: ClassVar[int] = 20741
    TYPE_CRC: ClassVar[int] = signature_crc(0)
    PRIORITY: ClassVar[int] = 8

    number: int

    def encode(self) -> bytes:
        """The payload."""
        return self.number.to_bytes(4, "little")

    @classmethod
    def decode(cls, payload: bytes) -> Self | None:
        """The value of a payload."""
        return cls(int.from_bytes(payload, "little")) if len(payload) == 4 else None


@dataclass(slots=True)
class StepDone(StepRequest):
    """Own type: in lock step, the emulator has made this step, and sent before what it had to send."""

    DATA_TYPE: ClassVar[int] = 20742


#: data type id -> class, of the messages that nodes broadcast
MESSAGES: dict[int, type[Message]] = {
    message.DATA_TYPE: message
    for message in (
        RawCommand,
        RPMCommand,
        Status,
        StatusExtended,
        NodeStatus,
        ArmingStatus,
        RotorSpeeds,
        SpeedsRequest,
        StepRequest,
        StepDone,
    )
}

#: the clock of lock step: no message in the sense of a flight, and so spared from what an impaired bus does
LOCKSTEP_TYPES = (StepRequest.DATA_TYPE, StepDone.DATA_TYPE)
