"""A flight over a bus keeps its diagnosis, says when the bus was bad, and keeps its data when it ends early."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from rotordx.hil_bridge.bridge import fly_over_bus
from rotordx.hil_bridge.buses import BusAddress
from rotordx.hil_bridge.settings import BridgeSettings
from rotordx.hil_bridge.timing import sentences
from rotordx.orchestrator import metrics, results
from rotordx.orchestrator.cli import main
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.scenario import load_scenario

HEALTHY = load_scenario("healthy_circle", ["duration_s=4"])
FAULTY = load_scenario("avram_circle", ["duration_s=4", "faults[0].onset_s=3", "faults[0].rotor=2"])


def fly(scenario, bus: str = "virtual:", **settings):
    return fly_over_bus(scenario, BridgeSettings(BusAddress.of(bus), lockstep=True, **settings))


def diagnosis(flight, diagnoser: str = "fdie"):
    return metrics.summarise(flight.recording)["diagnosers"][diagnoser]


@pytest.mark.parametrize("impairment", ["", "?loss=0.05&seed=1", "?loss=0.2&seed=1", "?delay=0.01"])
def test_no_false_alarm_and_degraded_where_it_is(impairment):
    flight = fly(HEALTHY, f"virtual:{impairment}")
    assert diagnosis(flight)["fault_detected"] is False
    bad = "0.2" in impairment or "delay" in impairment
    assert flight.figures["verdict"] == ("degraded" if bad else "complete")
    assert (flight.figures["degraded_from_s"] is not None) == bad
    assert bool(flight.recording.signals["bus.degraded"].any()) == bad


@pytest.mark.parametrize("impairment", ["", "?loss=0.05&seed=1", "?loss=0.2&seed=1", "?delay=0.01"])
def test_the_right_rotor_over_a_bad_bus(impairment):
    score = diagnosis(fly(FAULTY, f"virtual:{impairment}"))
    assert score["faulty_rotor"] == 2
    assert score["false_alarm"] is False


def test_telemetry_is_logged_as_signals():
    recording = fly(HEALTHY).recording
    rpm, age = recording.signals["bus.rpm"], recording.signals["bus.status_age"]
    assert rpm.shape == age.shape == (2001, 4)
    arrived = slice(50, None)
    assert np.nanmax(age[arrived]) <= 0.010 + 1e-9  # 100 Hz
    held = recording.signals["esc.rotor_speed"][arrived]
    assert np.abs(rpm[arrived] * np.pi / 30 - held).max() < 40  # at most 10 ms old
    assert recording.units["bus.rpm"] == "1/min"
    # one tick behind the model, which gets the same commands at once, and written in 13 bits
    model = recording.signals["esc_model.rotor_speed"]
    assert np.abs(recording.signals["esc.rotor_speed"][2:] - model[1:-1]).max() < 950 / 8191


def test_a_bus_that_goes_off_ends_the_flight_and_keeps_it():
    flight = fly(HEALTHY, "virtual:?bus_off=1.5")
    assert flight.verdict.startswith("ended at 1.500 s: the bus is lost: ")
    assert flight.recording.time[-1] == pytest.approx(1.5)
    assert flight.recording.scenario["duration_s"] == pytest.approx(1.5)
    assert {len(values) for values in flight.recording.signals.values()} == {751}


def test_rpm_commands_and_measured_speed():
    """What lowers a rotor's speed is no surprise to a diagnoser that knows the speed."""
    assert diagnosis(fly(FAULTY, command="rpm"))["faulty_rotor"] == 2
    assert diagnosis(fly(FAULTY, fed_speed="measured"))["fault_detected"] is False


def test_load_measured_is_the_load_planned():
    load = fly(HEALTHY).figures["bus_load"]
    assert load["measured"] == pytest.approx(load["planned"], abs=0.005)
    assert load["measured_without_stuff_bits"] == pytest.approx(load["planned_without_stuff_bits"], abs=0.005)


def test_a_result_folder_with_the_timing_report(tmp_path):
    out = tmp_path / "flown"
    arguments = ["hil", "hover", "--bus", "virtual:", "--lockstep", "--set", "duration_s=1", "--out", str(out)]
    shown = CliRunner().invoke(main, arguments)
    assert shown.exit_code == 0, shown.output
    summary = json.loads((out / "summary.json").read_text())
    assert summary["hil"]["mode"] == "lock step"
    assert summary["hil"]["lateness_s"] is None
    for sentence in sentences(summary["hil"]):
        assert sentence in shown.output
    recording, _ = results.read(out)
    assert len(recording.time) == 501
    assert "hil" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--bus", "socketcan:can0"], "take the propellers off and say so with --i-know-propellers-are-off"),
        (["--bus", "mcast:0", "--lockstep", "--escs", "real"], "real ESCs do not wait"),
        (["--bus", "virtual:", "--escs", "running"], "no other process can reach this bus"),
        (["--bus", "virtual:", "--status-rate", "500"], "more than 70 %: RawCommand at 500 Hz"),
        (["--bus", "virtual:", "--bit-rate", "250e3"], "of 250 kbit/s, more than 70 %"),
        (["--bus", "virtual:", "--watchdog", "0"], "--watchdog must be positive"),
        (["--bus", "virtual:", "--controller-node", "12"], "node ids must differ"),
        (["--bus", "can0"], "a bus begins with one of"),
        (["--bus", "virtual:", "--set", "duration=1"], "duration"),
    ],
)
def test_mistakes_are_refused(options, sentence, tmp_path):
    shown = CliRunner().invoke(main, ["hil", "hover", "--out", str(tmp_path / "out"), *options])
    assert shown.exit_code == 2, shown.output
    assert sentence in shown.output
    assert not (tmp_path / "out").exists()


def test_propellers_are_off_is_enough_to_try():
    with pytest.raises(UserError):
        BridgeSettings(BusAddress.of("socketcan:can0"))
    BridgeSettings(BusAddress.of("socketcan:can0"), propellers_are_off=True)


@pytest.mark.parametrize("command", ["hil", "esc"])
def test_help_has_an_example(command):
    shown = CliRunner().invoke(main, [command, "--help"])
    assert shown.exit_code == 0
    assert f"rotordx {command} " in shown.output.split("Examples:")[1]
