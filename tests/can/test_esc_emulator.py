"""Emulated ESCs turn only when armed and freshly commanded, and their telemetry is that of the esc FMU."""

from __future__ import annotations

import math

import numpy as np
import pytest
from esc_bench import ARM, DISARM, ESCS, LARGEST, STEP, bench, command

from rotordx.fmus.vehicles import load_vehicle
from rotordx.hil_bridge.emulator import EscSettings
from rotordx.hil_bridge.messages import NodeStatus, RawCommand, RotorSpeeds, RPMCommand, Status, StatusExtended
from rotordx.hil_bridge.protocol import Nodes
from rotordx.orchestrator.errors import UserError

QUANTUM = LARGEST / 8191
STALE_STEPS = 125  #: 250 ms


def test_motors_stand_still_until_armed():
    with bench() as esc:
        assert np.isnan(esc.step(command(500.0))).all()
        assert np.array_equal(esc.step(ARM), np.zeros(4))  # a command from before does not count
        assert esc.step(command(500.0)) == pytest.approx([500.0] * 4, abs=QUANTUM)
        esc.step(DISARM)
        reported = []
        for _ in range(10):
            esc.step(command(500.0))
            reported += [status.rpm for status in esc.all(Status)]
        assert set(reported) == {0}
        assert np.array_equal(esc.step(ARM), np.zeros(4))


def test_motors_stop_when_commands_are_stale_and_stay_so_until_disarmed():
    with bench() as esc:
        speed, running = esc.step(ARM, command(500.0)), 0
        while speed[0] > 0 and running < 2 * STALE_STEPS:
            speed, running = esc.step(), running + 1
        assert running == STALE_STEPS
        for _ in range(3):
            assert np.array_equal(esc.step(command(500.0)), np.zeros(4))
        assert np.array_equal(esc.step(ARM, command(500.0)), np.zeros(4))
        esc.step(DISARM)
        assert esc.step(ARM, command(500.0))[0] > 0


@pytest.mark.parametrize("stale_after", [0.05, 0.4])
def test_time_to_the_stop_is_configurable(stale_after):
    with bench(stale_after=stale_after) as esc:
        running = [bool(esc.step(*messages)[0] > 0) for messages in ((ARM, command(500.0)), *[()] * 300)]
        assert running == [k < round(stale_after / STEP) for k in range(301)]


@pytest.mark.parametrize("what", ["foreign", "repeated", "corrupt", "too short", "other type"])
def test_only_fresh_commands_of_the_controller_count(what):
    """Whatever else arrives in every step: the motors stop when the real command is stale."""
    with bench() as esc:
        link = esc.link
        esc.step(ARM, command(500.0))
        stopped = False
        for _ in range(STALE_STEPS + 2):
            node, message = 10, command(700.0)
            if what == "foreign":
                node = 20
            elif what == "repeated":
                link._transfer_ids[RawCommand.DATA_TYPE, 10, 0] -= 1
            elif what == "too short":
                message = RawCommand((7000, 7000, 7000))
            elif what == "other type":
                message = NodeStatus(1)
            elif what == "corrupt":
                message = RPMCommand((5000,) * 4)  # two frames, whose second one follows broken below
                send = link.bus.send

                def broken(frame, timeout=None, send=send):
                    if len(frame.data) < 8:
                        frame.data[0] ^= 0x10
                    send(frame, timeout)

                link.bus.send = broken
                link.send(node, message)
                del link.bus.send
                message = NodeStatus(1)
            speed = esc.step(message, node=node)
            assert speed[0] <= 500 + QUANTUM
            stopped = bool(speed[0] == 0)
        assert stopped


def test_zero_stops_and_the_next_command_starts_again():
    with bench("faults=[{rotor = 2, onset_s = 0.1, loss_of_effectiveness = 0.5}]") as esc:
        esc.step(ARM, command(500.0))
        for _ in range(100):
            speed = esc.step(command(500.0))
        assert speed[1] < 480
        assert np.array_equal(esc.step(command(0.0)), np.zeros(4))
        assert esc.step(command(500.0)) == pytest.approx([500.0] * 4, abs=QUANTUM)  # the clock of faults is at 0 again


def test_tools_that_do_not_ask_for_vendor_frames_get_none():
    with bench() as esc:
        esc.link.send(10, ARM)
        for _ in range(10):
            esc.step(command(500.0))
            assert esc.all(RotorSpeeds) == []


def test_reverse_is_refused():
    with bench() as esc:
        assert np.array_equal(esc.step(ARM, RawCommand((-8192,) * 4)), np.zeros(4))


def test_rpm_commands():
    with bench() as esc:
        assert esc.step(ARM, RPMCommand((5000, 5100, 5200, 5300))) == pytest.approx(
            np.array([5000, 5100, 5200, 5300]) * math.pi / 30, abs=QUANTUM
        )


def test_lag_and_loss_are_recovered_from_telemetry():
    """From rpm of Status alone: a step of the command, and a loss of 25 % of rotor 3 from 1 s on."""
    lag = load_vehicle("lab_x").parameters["motor_time_constant"]
    with bench("faults=[{rotor = 3, onset_s = 1.0, loss_of_effectiveness = 0.25}]", status_rate=500.0) as esc:
        esc.step(ARM, command(400.0))
        rpm = []
        for _ in range(1000):
            esc.step(command(600.0))
            rpm.append([status.rpm for status in sorted(esc.all(Status), key=lambda status: status.esc_index)])
    speed = np.array(rpm) * math.pi / 30
    rise = np.log((600 - speed[:30, 0]) / 200)
    times = STEP * np.arange(1, 31)
    recovered = -(times @ times) / (times @ rise)
    assert recovered == pytest.approx(lag, rel=0.02)
    loss = 1 - (speed[-100:, 2].mean() / speed[-100:, 1].mean()) ** 2
    assert loss == pytest.approx(0.25, rel=0.02)


def test_rates_of_the_reports():
    with bench(status_rate=100.0) as esc:
        esc.step(ARM, command(500.0))
        counts = dict.fromkeys((Status, StatusExtended, NodeStatus), 0)
        largest_burst = 0
        for _ in range(500):  # 1 s
            esc.step(command(500.0))
            for kind in counts:
                counts[kind] += len(esc.all(kind))
            largest_burst = max(largest_burst, len(esc.all(Status)))
        assert counts == {Status: 400, StatusExtended: 40, NodeStatus: 4}
        assert largest_burst <= 2  # ESCs take turns


def test_what_a_status_says():
    with bench() as esc:
        esc.step(ARM, command(500.0, 550.0, 600.0, 650.0))
        seen = {}
        for _ in range(3000):
            esc.step(command(500.0, 550.0, 600.0, 650.0))
            seen |= {
                received.source: received.message for received in esc.heard if isinstance(received.message, Status)
            }
    assert set(seen) == ESCS
    by_index = [seen[node] for node in sorted(seen)]
    assert [status.esc_index for status in by_index] == [0, 1, 2, 3]
    assert [status.rpm for status in by_index] == pytest.approx(
        np.array([500, 550, 600, 650]) * 30 / math.pi, abs=0.5 + QUANTUM * 30 / math.pi
    )
    power = 2e-7 * np.array([500.0, 550.0, 600.0, 650.0]) ** 3
    current = np.array([status.current for status in by_index])
    assert 0.8 * by_index[0].voltage * current == pytest.approx(power, rel=0.01)
    assert by_index[0].voltage == pytest.approx(12.4 - 0.02 * current.sum(), rel=2e-3)
    temperature = np.array([status.temperature for status in by_index])
    assert (temperature > 298.15).all()
    assert (np.diff(temperature) >= 0).all()
    assert temperature[-1] > temperature[0]
    assert [status.power_rating_percent for status in by_index] == [round(100 * p / (2e-7 * 950**3)) for p in power]


def test_missed_commands_are_counted():
    with bench() as esc:
        esc.step(ARM, command(500.0))
        for _ in range(3):
            esc.link._transfer_ids[RawCommand.DATA_TYPE, 10, 0] += 2
            esc.step(command(500.0))
        errors = 0
        for _ in range(10):
            esc.step(command(500.0))
            errors = max([errors, *(status.error_count for status in esc.all(Status))])
        assert errors == 6


@pytest.mark.parametrize("settings", [{"stale_after": 0.0}, {"status_rate": 0.0}, {"status_rate": 2000.0}])
def test_impossible_settings_are_refused(settings):
    with pytest.raises(UserError):
        EscSettings(**settings)


@pytest.mark.parametrize("ids", [(10, 8), (0, 11), (10, 125), (10, 11, 5), (10, 11, 0)])
def test_impossible_nodes_are_refused(ids):
    with pytest.raises(UserError):
        Nodes(*ids)
