"""Who is who on the bus, and how a rotor speed is written: what bridge and ESCs have to agree on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotordx.hil_bridge.messages import RAW_FULL_SCALE, RawCommand, RPMCommand
from rotordx.hil_bridge.transfer import LARGEST_NODE
from rotordx.orchestrator.errors import UserError

ROTORS = 4
NAME = "org.rotordx"
NODE_STATUS_PERIOD = 1.0  #: s, of each node; the longest that DroneCAN allows
ARMING_PERIOD = 0.2  #: s, in which the bridge says whether ESCs are armed, and asks emulated ones for speeds
EXTENDED_DIVIDER = 10  #: StatusExtended comes with every n-th Status
_PER_MINUTE = 60 / (2 * math.pi)  #: 1/min in a rad/s

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Nodes:
    """Node ids; ESC i has the index i - 1 in commands, and the i-th of the ids that begin with `first_esc`."""

    controller: int = 10
    first_esc: int = 11
    escs: int = ROTORS

    def __post_init__(self) -> None:
        if not 1 <= self.escs <= ROTORS:
            raise UserError(f"there can be 1 to {ROTORS} ESC nodes, not {self.escs}")
        ids = (self.controller, *self.esc_ids)
        if len(set(ids)) < len(ids) or not all(1 <= node <= LARGEST_NODE for node in ids):
            raise UserError(
                f"node ids must differ and be 1 to {LARGEST_NODE}, but the controller has {self.controller} and the "
                f"ESCs have {self.esc_ids[0]} to {self.esc_ids[-1]}"
            )

    @property
    def esc_ids(self) -> range:
        """Ids of the ESCs."""
        return range(self.first_esc, self.first_esc + self.escs)


def to_counts(speed: ArrayLike, largest: float) -> list[int]:
    """Rotor speeds (rad/s) as setpoints: `RAW_FULL_SCALE` is the largest speed."""
    counts: list[int] = np.rint(np.clip(np.asarray(speed) / largest, 0, 1) * RAW_FULL_SCALE).astype(int).tolist()
    return counts


def from_counts(counts: Sequence[int], largest: float) -> Array:
    """Rotor speeds (rad/s) of setpoints; ESCs that cannot reverse take a negative one for 0."""
    return np.maximum(np.array(counts, dtype=float), 0.0) * (largest / RAW_FULL_SCALE)


def to_rpm(speed: ArrayLike) -> list[int]:
    """Rotor speeds (rad/s) in whole revolutions a minute."""
    rpm: list[int] = np.rint(np.asarray(speed) * _PER_MINUTE).astype(int).tolist()
    return rpm


def from_rpm(rpm: Sequence[int]) -> Array:
    """Rotor speeds (rad/s) of revolutions a minute."""
    return np.maximum(np.array(rpm, dtype=float), 0.0) / _PER_MINUTE


def commanded_speed(message: RawCommand | RPMCommand, largest: float) -> Array | None:
    """(4,) rad/s that a command asks for; None if it is not for as many rotors."""
    counts = message.setpoints if isinstance(message, RawCommand) else message.rpm
    if len(counts) < ROTORS:
        return None
    first = counts[:ROTORS]
    return from_counts(first, largest) if isinstance(message, RawCommand) else from_rpm(first)
