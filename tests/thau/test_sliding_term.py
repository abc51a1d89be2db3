"""The sliding term of `asmto`: bounded as it flies, unstable as it is printed."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_design
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System
from tests.thau.driver import hovering, run

DT = 0.002
DESIGN = load_design("f450_plus", "asmto")["parameters"]


def noisy_hover(duration, seed=1):
    """Time and inputs of a healthy F450 with the noise of its sensors."""
    time = DT * np.arange(1, round(duration / DT) + 1)
    rng = np.random.default_rng(seed)
    inputs = hovering(time)
    inputs[:, 4:7] = 0.002 * rng.standard_normal((len(time), 3))
    inputs[:, 7:10] = 0.01 * rng.standard_normal((len(time), 3))
    return time, inputs


@pytest.fixture(scope="module")
def healthy():
    """Flies the healthy F450 with changed parameters of `asmto`."""
    scenario = load_scenario("nguyen_hong_healthy", diagnosers=["asmto"], components={"asmto": {}})
    with System(scenario) as system:

        def fly_with(duration, **parameters):
            changed = scenario.changed(duration_s=duration, components={"asmto": {"parameters": parameters}})
            return fly(changed, system, log_every=10)

        yield fly_with


@pytest.mark.parametrize("rate", [0.05, 0.1, 0.2])
def test_the_sign_form_is_unstable_in_discrete_time_for_every_alpha(healthy, rate):
    """Sampled sign(F1 e_y) overshoots by n h, so that |F1 e_y| and with it n' grow in proportion to n."""
    gain = healthy(120.0, sliding_form="sign", sliding_rate=rate).signals["asmto.sliding_gain"]
    assert (np.diff(gain) >= 0).all()
    middle = gain[len(gain) // 2]
    assert gain[-1] - middle > 1.5 * middle  # faster and faster


def test_the_sign_form_ends_in_a_false_alarm_and_stays_finite(healthy):
    signals = healthy(60.0, sliding_form="sign", sliding_rate=1.0).signals
    assert signals["asmto.sliding_gain"][-1] == 1e4
    assert signals["asmto.fault_detected"][-1] == 1
    assert np.isfinite(signals["asmto.acceleration_fault"]).all()


def test_in_ten_minutes_of_healthy_noisy_flight_the_gain_stays_next_to_nothing(healthy):
    signals = healthy(600.0).signals
    assert signals["asmto.sliding_gain"].max() < 1e-2 * DESIGN["sliding_gain_max"]
    assert signals["asmto.fault_detected"][-1] == 0


def test_the_gain_rises_in_a_disturbance_to_its_limit_at_most_and_returns():
    time, inputs = noisy_hover(12.0)
    shaken = time < 2.0
    inputs[shaken, 7:10] += 1.5 * np.sin(60 * time[shaken])[:, None]
    gain = run("asmto", time, inputs, sliding_rate=10.0, sliding_leak=0.5)["sliding_gain"]
    assert 0.9 * DESIGN["sliding_gain_max"] < gain[shaken].max() <= DESIGN["sliding_gain_max"]
    assert gain[-1] < 0.01 * gain[shaken].max()


def test_within_the_layer_the_term_opposes_the_error_in_proportion():
    time, inputs = noisy_hover(2.0)
    inputs[:, 7:10] += 0.5 * np.sin(20 * time)[:, None]
    found = run("asmto", time, inputs, sliding_rate=10.0, dead_zone=0.0, boundary_layer=1e3)
    error = np.hstack((found["euler_estimate"], found["body_rate_estimate"])) - inputs[:, 4:10]
    distance = error @ DESIGN["sliding_surface"]
    assert found["sliding_gain"][-1] > 0.1
    assert found["sliding_term"] == pytest.approx(-found["sliding_gain"] * distance / 1e3, abs=1e-9)
