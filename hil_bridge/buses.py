"""Buses by their URL: `socketcan:vcan0`, `virtual:name`, `udp_multicast:`, `mcast:0`, and what goes wrong on them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl

import can
from can.interfaces.udp_multicast import UdpMulticastBus

from rotordx.hil_bridge.impairment import ImpairedBus, Impairment
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import RunError, UserError

#: interface of python-can -> the channel of a URL that names none, and its options with their types
_KNOWN: dict[str, tuple[str, dict[str, type]]] = {
    "socketcan": ("vcan0", {}),
    "virtual": ("rotordx", {}),
    "udp_multicast": (UdpMulticastBus.DEFAULT_GROUP_IPv4, {"port": int, "hop_limit": int}),
    "mcast": ("0", {"interface_address": str, "time_to_live": int}),
}
#: what keeps frames on this machine, where python-can's default does not
_DEFAULTS: dict[str, dict[str, Any]] = {"udp_multicast": {"hop_limit": 0}}
_PROBABILITIES = ("loss", "duplicate", "reorder", "flip")


class BusError(RunError):
    """The bus does not work (any more)."""


@dataclass(frozen=True)
class BusAddress:
    """Which bus, and what goes wrong on it."""

    interface: str
    channel: str
    options: dict[str, Any]
    impairment: Impairment | None = None

    @classmethod
    def of(cls, url: str) -> BusAddress:
        """The address that a URL names: interface:channel?option=value&...

        Raises:
            UserError: it is none.
        """
        interface, separator, rest = url.partition(":")
        if interface not in _KNOWN or not separator:
            known = one_of([f"{name}:" for name in _KNOWN], f"{interface}:")
            raise UserError(f"--bus {url}: a bus begins with {known}, for example mcast:0 or socketcan:vcan0")
        channel, _, query = rest.partition("?")
        default, types = _KNOWN[interface]
        options, impairment = dict(_DEFAULTS.get(interface, {})), {}
        for name, text in parse_qsl(query, keep_blank_values=True):
            if name not in types and name not in Impairment.names():
                raise UserError(f"--bus {url}: {name} must be {one_of([*types, *Impairment.names()], name)}")
            if name in types:
                options[name] = _value(url, name, text, types[name])
            else:
                impairment[name] = _value(url, name, text, int if name == "seed" else float)
        for name, value in impairment.items():
            if value < 0 or (name in _PROBABILITIES and value > 1):
                raise UserError(
                    f"--bus {url}: {name} must be {'0 to 1' if name in _PROBABILITIES else '0 or larger'}, not {value}"
                )
        return cls(interface, channel or default, options, Impairment(**impairment) if impairment else None)

    @property
    def is_real(self) -> bool:
        """Whether motors may hang on it: anything but a bus that is known to be virtual."""
        return self.interface == "socketcan" and not self.channel.startswith(("vcan", "vxcan"))

    @property
    def is_in_process(self) -> bool:
        """Whether no other process can reach it."""
        return self.interface == "virtual"

    @property
    def perfect(self) -> BusAddress:
        """The same bus without impairment."""
        return BusAddress(self.interface, self.channel, self.options)

    def __str__(self) -> str:
        return f"{self.interface}:{self.channel}"


def open_bus(
    address: BusAddress,
    clock: Callable[[], float] = time.monotonic,
    spared: Collection[int] = (),
    nodes: Collection[int] = (),
) -> can.BusABC:
    """One end of a bus.

    Args:
        address: which.
        clock: s, see `ImpairedBus`.
        spared: DroneCAN data types that no impairment touches.
        nodes: ids of the nodes at this end.

    Raises:
        BusError: the machine has no such bus.
    """
    try:
        bus = can.Bus(channel=address.channel, interface=address.interface, **address.options)
    except (can.CanError, OSError, ValueError) as error:
        raise BusError(
            f"the bus {address} cannot be opened: {error}; check that it exists and is up ('ip link show')"
        ) from error
    return ImpairedBus(bus, address.impairment, clock, spared, nodes) if address.impairment else bus


def _value(url: str, name: str, text: str, kind: type) -> Any:
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if isinstance(value, float) and math.isnan(value):
        raise UserError(f"--bus {url}: {name} is {text!r} but must be a {'whole ' * (kind is int)}number")
    return value
