"""pydronecan as flight controller: it finds four nodes, arms and commands them, and sees them stop without it."""

from __future__ import annotations

import math

import dronecan
import pytest
from dronecan.app.node_monitor import NodeMonitor
from waiting import until

esc, safety = dronecan.uavcan.equipment.esc, dronecan.uavcan.equipment.safety
COMMANDS = [4000, 4200, 4400, 4600]


@pytest.fixture
def emulator(bus, rotordx):
    process = rotordx("esc", "--bus", bus, "--nodes", "4", "--stale-after", "0.3")
    assert process.stderr.readline().startswith("ESC nodes 11, 12, 13, 14 on ")
    return process


@pytest.fixture
def node(theirs, emulator):
    node = dronecan.make_node(theirs, node_id=10, bitrate=1_000_000)
    yield node
    node.close()


def test_as_its_own_nodes(node):
    monitor, status = NodeMonitor(node), {}
    node.add_handler(esc.Status, lambda event: status.__setitem__(event.transfer.source_node_id, event.message))

    def turn(armed: bool) -> None:
        node.broadcast(safety.ArmingStatus(status=255 if armed else 0))
        node.broadcast(esc.RawCommand(cmd=COMMANDS))
        node.spin(0.005)

    def rpm() -> list[int]:
        return [status[n].rpm for n in sorted(status)]

    until(lambda: turn(False) is None and len(list(monitor.find_all(lambda entry: entry.info is not None))) == 4)
    names = {entry.node_id: str(entry.info.name) for entry in monitor.find_all(lambda _: True)}
    assert names == {10 + i: f"org.rotordx.esc{i}" for i in range(1, 5)}
    assert rpm() == [0, 0, 0, 0]  # commanded but not armed

    expected = [count / 8191 * 950 * 30 / math.pi for count in COMMANDS]
    until(lambda: turn(True) is None and rpm() == pytest.approx(expected, abs=1))
    assert [status[n].esc_index for n in sorted(status)] == [0, 1, 2, 3]

    until(lambda: node.spin(0.005) < 0 or rpm() == [0, 0, 0, 0])  # no more commands
