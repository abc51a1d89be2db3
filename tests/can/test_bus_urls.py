"""A bus is named by a URL; what is wrong in one is said with what to do."""

from __future__ import annotations

import pytest

from rotordx.hil_bridge.buses import BusAddress, BusError, open_bus
from rotordx.hil_bridge.impairment import Impairment
from rotordx.orchestrator.errors import UserError


@pytest.mark.parametrize(
    ("url", "interface", "channel"),
    [
        ("mcast:", "mcast", "0"),
        ("mcast:3", "mcast", "3"),
        ("socketcan:vcan1", "socketcan", "vcan1"),
        ("udp_multicast:239.1.2.3", "udp_multicast", "239.1.2.3"),
        ("virtual:here", "virtual", "here"),
    ],
)
def test_interface_and_channel(url, interface, channel):
    address = BusAddress.of(url)
    assert (address.interface, address.channel, address.impairment) == (interface, channel, None)
    assert str(address) == f"{interface}:{channel}"


def test_options_and_impairment():
    address = BusAddress.of("mcast:1?time_to_live=1&interface_address=10.0.0.1&loss=0.05&delay=0.01&seed=4")
    assert address.options == {"time_to_live": 1, "interface_address": "10.0.0.1"}
    assert address.impairment == Impairment(loss=0.05, delay=0.01, seed=4)
    assert address.perfect.impairment is None


def test_nothing_leaves_the_machine_unless_asked_for():
    assert BusAddress.of("udp_multicast:").options == {"hop_limit": 0}


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("vcan0", r"--bus vcan0: a bus begins with one of .*, for example mcast:0"),
        ("mcst:0", r"did you mean mcast:\?"),
        ("mcast:0?los=0.1", r"los must be one of .*did you mean loss\?"),
        ("mcast:0?loss=2", "loss must be 0 to 1, not 2"),
        ("mcast:0?delay=-1", "delay must be 0 or larger"),
        ("mcast:0?delay=soon", "delay is 'soon' but must be a number"),
        ("mcast:0?loss=nan", "loss is 'nan' but must be a number"),
        ("mcast:0?seed=0.5", "seed is '0.5' but must be a whole number"),
    ],
)
def test_mistakes_are_refused(url, sentence):
    with pytest.raises(UserError, match=sentence):
        BusAddress.of(url)


@pytest.mark.parametrize("url", ["socketcan:vcan977", "mcast:999"])
def test_a_bus_that_is_not_there(url):
    with pytest.raises(BusError, match=r"cannot be opened: .*; check that it exists and is up"):
        open_bus(BusAddress.of(url))


@pytest.mark.parametrize(("url", "real"), [("socketcan:can0", True), ("socketcan:vcan0", False), ("mcast:", False)])
def test_motors_may_hang_on_a_real_bus_only(url, real):
    assert BusAddress.of(url).is_real is real
