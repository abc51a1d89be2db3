"""Paper 003 on its attitude system: the threshold holds and is tight, both faults are found and estimated."""

import numpy as np
import pytest

from rotordx.orchestrator.reproduction.rho_adaptive.attitude_experiments import ABRUPT, INCIPIENT, experiments, outcomes
from rotordx.orchestrator.reproduction.rho_adaptive.attitude_system import BODY_RATE, attitude_gain, lipschitz
from rotordx.orchestrator.reproduction.rho_adaptive.fault_free import fault_free_runs

CONDITIONS = ("none", "uncertainty", "noise", "both")


@pytest.fixture(scope="module")
def found():
    wanted = {f"{fault}, {condition}" for fault in ("incipient", "abrupt") for condition in CONDITIONS}
    wanted |= {"roll channel", "acceleration", "N 0.1"}
    return outcomes({name: experiment for name, experiment in experiments().items() if name in wanted})


@pytest.mark.xdist_group("rho_adaptive")
def test_no_healthy_run_crosses_the_threshold_and_some_come_close():
    runs = fault_free_runs(210, seed=3)
    assert runs.ratio.shape == (210,)
    assert runs.body_rate.max() <= BODY_RATE
    assert 0.9 < runs.ratio.max() <= 1


@pytest.mark.xdist_group("rho_adaptive")
def test_a_threshold_without_uncertainty_and_noise_is_crossed():
    assert np.mean(fault_free_runs(45, seed=4, bounds_in_threshold=False).ratio > 1) >= 0.95


@pytest.mark.xdist_group("rho_adaptive")
@pytest.mark.parametrize(("fault", "latest", "largest_error"), [("incipient", 15.45, 1e-5), ("abrupt", 10.05, 2.5e-4)])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_both_faults_are_detected_in_time_and_estimated(found, fault, latest, largest_error, condition):
    outcome = found[f"{fault}, {condition}"]
    for diagnoser in ("rho_adaptive", "smo"):
        assert outcome.onset < outcome.detection_time[diagnoser] <= latest
        error = outcome.mean_squared_error(diagnoser)
        assert error <= largest_error
        assert error <= outcome.error_of_zero() / 20


@pytest.mark.xdist_group("rho_adaptive")
def test_nothing_is_estimated_before_detection(found):
    outcome = found["incipient, both"]
    before = outcome.time < outcome.detection_time["rho_adaptive"]
    assert not outcome.estimate["rho_adaptive"][before].any()


@pytest.mark.xdist_group("rho_adaptive")
@pytest.mark.parametrize("name", ["roll channel", "acceleration"])
def test_a_fault_below_the_uncertainty_is_not_detected(found, name):
    outcome = found[name]
    assert np.all(np.isnan(list(outcome.detection_time.values())))
    assert np.max(outcome.residual / outcome.threshold) < 0.5


@pytest.mark.xdist_group("rho_adaptive")
def test_too_small_a_modification_norm_biases_the_estimate(found):
    assert found["N 0.1"].estimate["rho_adaptive"][-1] == pytest.approx(0.12, abs=0.01)
    assert found["abrupt, both"].estimate["rho_adaptive"][-1] == pytest.approx(0.25, abs=2e-3)


def test_the_gain_is_that_of_the_closed_form():
    gain, proof = attitude_gain()
    assert lipschitz() == pytest.approx(1.4222, abs=1e-4)
    closed_form = 2 * 8.0 + 2 * lipschitz() + 1
    np.testing.assert_allclose(gain, closed_form * np.eye(3), atol=1e-3 * closed_form)
    assert proof.overshoot == pytest.approx(1, rel=2e-3)


def test_the_faults_are_those_of_the_paper():
    assert INCIPIENT.fault(15.0) == ABRUPT.fault(10.0) == 0.0
    assert INCIPIENT.fault(17.0) * 0.8 == pytest.approx((1 - np.exp(-1.0)) * 0.8 * 0.1)
    assert ABRUPT.fault(10.002) == 0.25
