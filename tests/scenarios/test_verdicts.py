"""The packaged scenarios end with the verdicts that the README promises."""

from __future__ import annotations

import pytest

from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.scenario import Scenario, load_scenario


def score(scenario: Scenario) -> dict:
    return summarise(fly(scenario))["diagnosers"]["fdie"]


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_loss_of_20_percent_is_detected_isolated_and_estimated(rotor):
    found = score(load_scenario("avram_circle", [f"faults[0].rotor={rotor}"]))
    assert not found["false_alarm"]
    assert found["detection_delay_s"] <= 0.1
    assert found["isolation_correct"]
    assert found["isolation_delay_s"] <= 0.25
    assert found["loe_estimate"][rotor - 1] == pytest.approx(0.2, abs=0.01)
    assert abs(found["loe_final_error"]) <= 0.01


def test_a_loss_of_10_percent_in_hover_is_detected_isolated_and_estimated():
    found = score(load_scenario("hover"))
    assert (found["false_alarm"], found["isolation_correct"]) == (False, True)
    assert (found["detection_delay_s"] <= 0.2, found["isolation_delay_s"] <= 0.45) == (True, True)
    assert abs(found["loe_final_error"]) <= 0.01


@pytest.mark.parametrize("name", ["healthy_circle", "vertical_sine", "roll_sine"])
def test_a_healthy_flight_raises_no_alarm(name):
    found = score(load_scenario(name))
    assert not found["fault_detected"]
    assert found["peak_residual_ratio_before_fault"] <= 0.9


@pytest.mark.parametrize("name", ["ellipse", "waypoints"])
def test_other_fault_profiles_are_detected_and_no_wrong_rotor_is_named(name):
    scenario = load_scenario(name)
    found = score(scenario)
    assert (found["fault_detected"], found["false_alarm"]) == (True, False)
    assert found["faulty_rotor"] in (0, -1, scenario.faults[0].rotor)
