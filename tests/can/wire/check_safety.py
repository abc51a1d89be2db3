"""Who is killed in flight leaves the others safe: motors stop, the verdict says so, and the data are kept."""

from __future__ import annotations

import json
from contextlib import closing

import pytest
from waiting import until

from rotordx.hil_bridge.buses import BusAddress, open_bus
from rotordx.hil_bridge.link import Link
from rotordx.hil_bridge.messages import NodeStatus, RawCommand, Status, StatusExtended
from rotordx.orchestrator import results

ESCS = {11, 12, 13, 14}


@pytest.fixture
def emulator(bus, rotordx):
    process = rotordx("esc", "--bus", bus)
    assert process.stderr.readline().startswith("ESC nodes")
    return process


@pytest.fixture
def observer(bus):
    """Hears the ESCs' Status and the controller's commands."""
    link = Link(open_bus(BusAddress.of(bus)), {}, {Status: ESCS, RawCommand: {10}, StatusExtended: (), NodeStatus: ()})
    yield link
    link.close()


def fly(rotordx, bus: str, *options: str):
    return rotordx("hil", "hover", "--bus", bus, "--escs", "running", "--out", "flown", *options)


def wait_for_turning_motors(observer) -> None:
    """Until motors have been turning for some time."""
    turning = 0

    def for_some_time() -> bool:
        nonlocal turning
        received = observer.receive(1.0)
        turning += received is not None and isinstance(received.message, Status) and received.message.rpm > 1000
        return turning >= 50

    until(for_some_time)


@pytest.mark.parametrize("mode", [(), ("--lockstep",)], ids=["real_time", "lock_step"])
def test_emulator_killed_in_flight(bus, rotordx, emulator, observer, tmp_path, mode):
    hil = fly(rotordx, bus, "--watchdog", "0.5", "--set", "duration_s=600", *mode)
    wait_for_turning_motors(observer)
    emulator.kill()
    output, errors = hil.communicate(timeout=60)
    assert hil.returncode == 1
    reason = "has not made its step" if mode else "has been silent for"
    assert "Error: the flight ended at" in errors
    assert reason in errors
    assert "; what was flown is in flown" in errors
    assert "ended at" in output
    recording, summary = results.read(tmp_path / "flown")
    assert summary["duration_s"] == pytest.approx(recording.time[-1])
    assert len(recording.time) > 2
    if not mode:  # at the first tick after the watchdog, however late the machine was with that
        hil_figures = json.loads((tmp_path / "flown" / "summary.json").read_text())["hil"]
        silence = float(hil_figures["verdict"].split("silent for ")[1].split(" ms")[0])
        assert 500 <= silence <= 520 + 1e3 * hil_figures["lateness_s"]["max"]


def test_bridge_killed_in_flight(bus, rotordx, emulator, observer):
    hil = fly(rotordx, bus, "--watchdog", "5", "--set", "duration_s=600")
    wait_for_turning_motors(observer)
    hil.kill()
    hil.wait()
    stopped = set()

    def all_stopped() -> bool:
        received = observer.receive(1.0)
        if received is not None and isinstance(received.message, Status) and received.message.rpm == 0:
            stopped.add(received.source)
        return stopped == ESCS

    until(all_stopped)


def test_motors_stop_at_the_end_of_a_flight(bus, rotordx, emulator):
    commands = []
    with closing(Link(open_bus(BusAddress.of(bus)), {}, {RawCommand: {10}})) as link:
        hil = fly(rotordx, bus, "--watchdog", "5", "--set", "duration_s=0.5")
        ended = False
        while not ended:
            ended = hil.poll() is not None  # what it sent before is taken below
            while (received := link.receive(0.2)) is not None:
                commands.append(received.message.setpoints)
    assert hil.returncode == 0
    assert len(commands) > 100
    assert commands[-1] == (0, 0, 0, 0)
    assert commands[-4] != (0, 0, 0, 0)
