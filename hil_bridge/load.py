"""How busy a bus is: bits of CAN 2.0B frames, planned from rates and counted from what was seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rotordx.hil_bridge.messages import (
    ArmingStatus,
    NodeStatus,
    RawCommand,
    RotorSpeeds,
    RPMCommand,
    SpeedsRequest,
    Status,
    StatusExtended,
)
from rotordx.hil_bridge.protocol import ARMING_PERIOD, EXTENDED_DIVIDER, NODE_STATUS_PERIOD
from rotordx.hil_bridge.transfer import to_frames
from rotordx.orchestrator.errors import UserError

LARGEST_LOAD = 0.7  #: of the bit rate, above which frames of low priority wait too long
_STUFFED, _UNSTUFFED = 54, 13  #: bits of a 29-bit frame without data: subject to stuffing; delimiters, end and gap

RAW, RPM = "raw", "rpm"  #: the two commands
_PAYLOADS = {
    "RawCommand": len(RawCommand((0,) * 4).encode()),
    "RPMCommand": len(RPMCommand((0,) * 4).encode()),
    "ArmingStatus": len(ArmingStatus(0).encode()),
    "NodeStatus": len(NodeStatus(0).encode()),
    "RotorSpeeds": len(RotorSpeeds((0, 0, 0, 0), 0).encode()),
    "SpeedsRequest": len(SpeedsRequest().encode()),
    "Status": len(Status(0, 0, 0, 0, 0, 0, 0).encode()),
    "StatusExtended": len(StatusExtended(0, 0, 0, 0, 0, 0).encode()),
}


def frame_bits(data_bytes: int, *, stuffed: bool) -> int:
    """Bits that a frame takes on the bus, the gap after it included.

    Args:
        data_bytes: 0 to 8.
        stuffed: with the largest possible number of stuff bits, one after the first five bits and after every four
            more; else with none.
    """
    bits = _STUFFED + 8 * data_bytes
    return bits + _UNSTUFFED + ((bits - 1) // 4 if stuffed else 0)


@dataclass(frozen=True)
class Plan:
    """Messages a second on a bus."""

    rates: Mapping[str, float]  #: name of the data type -> Hz
    bit_rate: float  #: bit/s

    def share(self, name: str, *, stuffed: bool = True) -> float:
        """Share of the bit rate that one data type takes."""
        frames = to_frames(bytes(_PAYLOADS[name]), 0, 0)
        bits = sum(frame_bits(len(frame), stuffed=stuffed) for frame in frames)
        return self.rates[name] * bits / self.bit_rate

    def load(self, *, stuffed: bool = True) -> float:
        """Share of the bit rate that all take."""
        return sum(self.share(name, stuffed=stuffed) for name in self.rates)

    def check(self) -> None:
        """Refuse what does not fit.

        Raises:
            UserError: more than `LARGEST_LOAD`; with the figures.
        """
        if self.load() > LARGEST_LOAD:
            parts = ", ".join(
                f"{name} at {rate:g} Hz {100 * self.share(name):.1f} %" for name, rate in self.rates.items()
            )
            raise UserError(
                f"the bus would be loaded to {100 * self.load():.0f} % of {self.bit_rate / 1e3:g} kbit/s, more than "
                f"{100 * LARGEST_LOAD:.0f} %: {parts}; lower --status-rate or the rate of the flight (step_size_s)"
            )


def plan(step_size: float, status_rate: float, escs: int, *, command: str, emulated: bool, bit_rate: float) -> Plan:
    """What bridge and ESCs send: a command every step (s), telemetry at a rate (Hz) of each ESC."""
    per_second = 1 / step_size
    rates = {
        "RawCommand" if command == RAW else "RPMCommand": per_second,
        "RotorSpeeds": per_second if emulated else 0.0,
        "SpeedsRequest": 1 / ARMING_PERIOD if emulated else 0.0,
        "Status": escs * status_rate,
        "StatusExtended": escs * status_rate / EXTENDED_DIVIDER,
        "NodeStatus": (escs + 1) / NODE_STATUS_PERIOD,
        "ArmingStatus": 1 / ARMING_PERIOD,
    }
    return Plan({name: rate for name, rate in rates.items() if rate}, bit_rate)


def measured_load(frames: Mapping[int, int], duration: float, bit_rate: float, *, stuffed: bool) -> float:
    """Share of the bit rate that the frames seen (data bytes -> count) took in a time (s)."""
    bits = sum(count * frame_bits(length, stuffed=stuffed) for length, count in frames.items())
    return bits / (duration * bit_rate)
