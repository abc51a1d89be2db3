"""Bit fields of DroneCAN payloads, packed without gaps.

The first field comes first, a whole number with its low byte first, and every byte with its highest bit first.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

LARGEST_HALF = 65504.0  #: the largest finite float16
LARGEST_COMMAND_COUNT = 20


def saturated(value: int, lowest: int, highest: int) -> int:
    """The value in its range nearest to a number."""
    return lowest if value < lowest else highest if value > highest else value


def swapped(value: int, bits: int) -> int:
    """A field of up to 24 bits as a big-endian bit string holds it: low byte first."""
    low, middle = value & 0xFF, value >> 8 & 0xFF
    if bits > 16:
        return (low << 8 | middle) << bits - 16 | value >> 16 & (1 << bits - 16) - 1
    return low << bits - 8 | value >> 8 & (1 << bits - 8) - 1


def unswapped(field: int, bits: int) -> int:
    """The field that `swapped` made."""
    if bits > 16:
        return field >> bits - 8 & 0xFF | (field >> bits - 16 & 0xFF) << 8 | (field & (1 << bits - 16) - 1) << 16
    return field >> bits - 8 & 0xFF | (field & (1 << bits - 8) - 1) << 8


def signed(value: int, bits: int) -> int:
    """The number that a field holds as its two's complement."""
    return value - (1 << bits) if value >> bits - 1 else value


def pack_array(values: Iterable[int], bits: int) -> bytes:
    """An array of signed numbers that ends the payload, and so has no length of its own."""
    highest = (1 << bits - 1) - 1
    joined = length = 0
    for value in values:
        joined = joined << bits | swapped(saturated(value, -highest - 1, highest), bits)
        length += bits
    padding = -length % 8
    return (joined << padding).to_bytes((length + padding) // 8, "big")


def unpack_array(payload: bytes, bits: int) -> tuple[int, ...] | None:
    """The numbers of such an array; None for what is none, or longer than any command."""
    count, padding = divmod(8 * len(payload), bits)
    if padding > 7 or count > LARGEST_COMMAND_COUNT:
        return None
    joined, mask = int.from_bytes(payload, "big") >> padding, (1 << bits) - 1
    return tuple(
        signed(unswapped(joined >> shift & mask, bits), bits) for shift in range(bits * (count - 1), -1, -bits)
    )


def halves(values: Sequence[float]) -> bytes:
    """Numbers as float16, rounded to nearest with ties away from zero like libuavcan does; NaN is "unknown"."""
    clipped = [LARGEST_HALF if x > LARGEST_HALF else -LARGEST_HALF if x < -LARGEST_HALF else x for x in values]
    singles = struct.unpack(f"<{len(clipped)}I", struct.pack(f"<{len(clipped)}f", *clipped))
    return struct.pack(f"<{len(clipped)}H", *map(_half, singles))


def _half(single: int) -> int:
    """Bits of a float16 from those of a float32."""
    sign, magnitude = single >> 16 & 0x8000, single & 0x7FFFFFFF
    if magnitude >= 0x38800000:  # at least the smallest normal float16, 2^-14; not more than the largest, or NaN
        return sign | (0x7FFF if magnitude > 0x7F800000 else magnitude + 0x1000 - 0x38000000 >> 13)
    if magnitude < 0x33000000:  # less than half of the smallest subnormal one, 2^-25
        return sign
    mantissa, shift = magnitude & 0x7FFFFF | 0x800000, 126 - (magnitude >> 23)
    return sign | mantissa + (1 << shift - 1) >> shift
