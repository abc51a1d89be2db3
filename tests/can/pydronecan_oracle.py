"""pydronecan's view of the messages: what it makes of our values, and what it sends for the same ones."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any, NamedTuple

import dronecan
from dronecan import transport

from rotordx.hil_bridge.messages import (
    ArmingStatus,
    GetNodeInfo,
    NodeStatus,
    RawCommand,
    RPMCommand,
    Status,
    StatusExtended,
)

esc, protocol, safety = dronecan.uavcan.equipment.esc, dronecan.uavcan.protocol, dronecan.uavcan.equipment.safety


class Case(NamedTuple):
    """A data type: random values of ours, and the two ways between ours and pydronecan's."""

    random: Callable[[random.Random], Any]
    theirs: Callable[[Any], Any]
    ours: Callable[[Any], Any]


def _whole(rng: random.Random, bits: int, signed: bool = False) -> int:
    """Mostly in range, sometimes at its end, sometimes beyond it."""
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    return rng.choice((low, high, low - 3, high + 1000)) if rng.random() < 0.05 else rng.randint(low, high)


def _real(rng: random.Random) -> float:
    special = (0.0, -0.0, 65504.0, 65519.9, 1e9, -1e9, math.inf, -math.inf, math.nan, 2.0**-24, 2.0**-25, 1 + 2.0**-11)
    kind = rng.random()
    if kind < 0.1:
        return rng.choice(special)
    return rng.uniform(-400, 400) if kind < 0.6 else rng.choice((-1, 1)) * 2.0 ** rng.uniform(-28, 17)


def _node_status(rng: random.Random) -> NodeStatus:
    return NodeStatus(*(_whole(rng, bits) for bits in (32, 2, 3, 3, 16)))


def _their_node_status(m: NodeStatus) -> Any:
    return protocol.NodeStatus(
        uptime_sec=m.uptime, health=m.health, mode=m.mode, sub_mode=m.sub_mode,
        vendor_specific_status_code=m.vendor_code,
    )  # fmt: skip


def _our_node_status(t: Any) -> NodeStatus:
    return NodeStatus(t.uptime_sec, t.health, t.mode, t.sub_mode, t.vendor_specific_status_code)


def _node_info(rng: random.Random) -> GetNodeInfo:
    def byte() -> int:
        return rng.randrange(256)

    return GetNodeInfo(
        _node_status(rng),
        "".join(rng.choices("abcdefghijklmnopqrstuvwxyz0123456789.-_", k=rng.randint(0, 80))),
        (byte(), byte()),
        byte(),
        rng.getrandbits(32),
        rng.getrandbits(64),
        (byte(), byte()),
        rng.randbytes(16),
        rng.randbytes(rng.choice((0,) * 57 + (1, 40, 255))),
    )


def _their_node_info(m: GetNodeInfo) -> Any:
    t = protocol.GetNodeInfo.Response()
    t.status = _their_node_status(m.status)
    t.software_version.major, t.software_version.minor = m.software_version
    t.software_version.optional_field_flags = m.optional_fields
    t.software_version.vcs_commit, t.software_version.image_crc = m.vcs_commit, m.image_crc
    t.hardware_version.major, t.hardware_version.minor = m.hardware_version
    for i, value in enumerate(m.unique_id):
        t.hardware_version.unique_id[i] = value
    t.hardware_version.certificate_of_authenticity.from_bytes(m.certificate)
    t.name.encode(m.name)
    return t


def _our_node_info(t: Any) -> GetNodeInfo:
    s, h = t.software_version, t.hardware_version
    return GetNodeInfo(
        _our_node_status(t.status), t.name.decode(), (s.major, s.minor), s.optional_field_flags, s.vcs_commit,
        s.image_crc, (h.major, h.minor), h.unique_id.to_bytes(), h.certificate_of_authenticity.to_bytes(),
    )  # fmt: skip


CASES = {
    "RawCommand": Case(
        lambda rng: RawCommand(tuple(_whole(rng, 14, True) for _ in range(rng.choice((4, 4, 4, rng.randint(1, 20)))))),
        lambda m: esc.RawCommand(cmd=list(m.setpoints)),
        lambda t: RawCommand(tuple(t.cmd)),
    ),
    "RPMCommand": Case(
        lambda rng: RPMCommand(tuple(_whole(rng, 18, True) for _ in range(rng.choice((4, 4, 4, rng.randint(1, 20)))))),
        lambda m: esc.RPMCommand(rpm=list(m.rpm)),
        lambda t: RPMCommand(tuple(t.rpm)),
    ),
    "Status": Case(
        lambda rng: Status(
            _whole(rng, 32), _real(rng), _real(rng), _real(rng), _whole(rng, 18, True), _whole(rng, 7), _whole(rng, 5)
        ),
        lambda m: esc.Status(
            error_count=m.error_count, voltage=m.voltage, current=m.current, temperature=m.temperature, rpm=m.rpm,
            power_rating_pct=m.power_rating_percent, esc_index=m.esc_index,
        ),
        lambda t: Status(
            t.error_count, t.voltage, t.current, t.temperature, t.rpm, t.power_rating_pct, t.esc_index
        ),
    ),
    "StatusExtended": Case(
        lambda rng: StatusExtended(
            _whole(rng, 7), _whole(rng, 7), _whole(rng, 9, True), _whole(rng, 9), _whole(rng, 19), _whole(rng, 5)
        ),
        lambda m: esc.StatusExtended(
            input_pct=m.input_percent, output_pct=m.output_percent, motor_temperature_degC=m.motor_temperature,
            motor_angle=m.motor_angle, status_flags=m.status_flags, esc_index=m.esc_index,
        ),
        lambda t: StatusExtended(
            t.input_pct, t.output_pct, t.motor_temperature_degC, t.motor_angle, t.status_flags, t.esc_index
        ),
    ),
    "NodeStatus": Case(_node_status, _their_node_status, _our_node_status),
    "ArmingStatus": Case(
        lambda rng: ArmingStatus(_whole(rng, 8)),
        lambda m: safety.ArmingStatus(status=m.status),
        lambda t: ArmingStatus(t.status),
    ),
    "GetNodeInfo": Case(_node_info, _their_node_info, _our_node_info),
}  # fmt: skip


def their_frames(payload: Any, *, source: int, transfer_id: int, priority: int, destination: int | None = None) -> Any:
    """(CAN id, contents) of the frames that pydronecan sends; with a destination, of a service's response."""
    transfer = transport.Transfer(
        payload=payload,
        source_node_id=source,
        dest_node_id=destination,
        transfer_id=transfer_id,
        transfer_priority=priority,
        service_not_message=destination is not None,
    )
    return [(frame.message_id, bytes(frame.bytes)) for frame in transfer.to_frames()]


def what_they_read(frames: list[tuple[int, bytes]]) -> Any:
    """The message that pydronecan finds in frames.

    Raises:
        dronecan.transport.TransferError: it refuses them.
    """
    transfer = transport.Transfer()
    transfer.from_frames([transport.Frame(can_id, bytearray(data)) for can_id, data in frames])
    return transfer.payload
