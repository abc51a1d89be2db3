"""A lock-step flight is the same on every bus, bit by bit, and within a tick a hop that without a bus."""

from __future__ import annotations

import numpy as np
import pytest

from rotordx.hil_bridge.bridge import fly_over_bus
from rotordx.hil_bridge.buses import BusAddress
from rotordx.hil_bridge.settings import BridgeSettings
from rotordx.orchestrator import metrics
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario

#: the circle of paper 000, its loss brought forward
SCENARIO = load_scenario("avram_circle", ["faults[0].onset_s=2.5", "duration_s=3"])


def over(bus: str, scenario=SCENARIO):
    return fly_over_bus(scenario, BridgeSettings(BusAddress.of(bus), lockstep=True))


@pytest.fixture(scope="module")
def in_process():
    return over("virtual:lockstep")


@pytest.mark.parametrize("impairment", ["", "?loss=0.05&delay=0.003&jitter=0.002&seed=2"])
def test_bit_equal(bus, in_process, impairment):
    scenario = SCENARIO.changed(duration_s=1.0) if impairment else SCENARIO
    reference = over(f"virtual:lockstep{impairment}", scenario) if impairment else in_process
    flight = over(bus + impairment, scenario)
    assert flight.verdict is None
    assert list(flight.recording.signals) == list(reference.recording.signals)
    for key, values in flight.recording.signals.items():
        assert np.array_equal(values, reference.recording.signals[key], equal_nan=True), key
    assert flight.figures["frames"] == reference.figures["frames"]
    if not impairment:
        assert set(flight.figures["frames"].values()) == {0}
        assert flight.figures["held_ticks"] == 0


def test_times_of_the_diagnosis_are_those_without_a_bus(in_process):
    """Command and answer are one hop each, and together cost one tick."""
    step = SCENARIO.step_size_s
    ours, without = (metrics.summarise(r)["diagnosers"]["fdie"] for r in (in_process.recording, fly(SCENARIO)))
    assert ours["faulty_rotor"] == without["faulty_rotor"] == 1
    for event in ("detection_time_s", "isolation_time_s"):
        assert abs(ours[event] - without[event]) <= 2 * step + 1e-9
