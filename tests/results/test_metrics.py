"""The figures of summary.json are what their definitions say, also where something is missing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rotordx.orchestrator import metrics
from tests.results.hand_made import FAULT, recording

OTHER = FAULT | {"rotor": 4, "onset_s": 6.0, "loss_of_effectiveness": 0.1}


def score(**how):
    return metrics.summarise(recording(**how))["diagnosers"]["d"]


def test_a_right_diagnosis_has_all_figures():
    assert score() == {
        "fault_detected": True,
        "detection_time_s": 4.5,
        "detection_delay_s": 0.5,
        "false_alarm": False,
        "faulty_rotor": 2,
        "isolation_time_s": 5.0,
        "isolation_delay_s": 1.0,
        "isolation_correct": True,
        "loe_estimate": [0.0, 0.28, 0.0, 0.0],
        "loe_rmse": pytest.approx(0.02),
        "loe_final_error": pytest.approx(-0.02),
        "peak_residual_ratio_before_fault": 0.5,
        "step_time_ns": 250.0,
    }


def test_the_summary_is_the_contract():
    summary = metrics.summarise(recording())
    assert {key: value for key, value in summary.items() if key != "diagnosers"} == {
        "scenario": "by hand",
        "vehicle": "lab_x",
        "seed": 7,
        "step_size_s": 0.1,
        "duration_s": 10.0,
        "steps": 100,
        "wall_time_s": 0.5,
        "real_time_factor": 20.0,
        "faults": [FAULT],
    }
    assert list(summary["diagnosers"]["d"]) == list(metrics.MEANING)
    json.dumps(summary, allow_nan=False)


def test_steps_are_those_of_the_scenario_if_not_every_step_was_logged():
    flown = recording()
    flown.scenario.update(step_size_s=0.002, duration_s=10.0)
    summary = metrics.summarise(flown)
    assert (summary["step_size_s"], summary["steps"]) == (0.002, 5000)


def test_a_missed_fault_has_no_times():
    missed = score(detection=None, isolation=None)
    assert missed["fault_detected"] is False
    assert missed["false_alarm"] is False
    assert missed["isolation_correct"] is False
    times = ("detection_time_s", "detection_delay_s", "isolation_time_s", "isolation_delay_s")
    assert [missed[key] for key in (*times, "loe_rmse", "loe_final_error")] == [None] * 6


def test_an_alarm_before_the_fault_is_false_and_has_no_delay():
    early = score(detection=2.0, isolation=2.5)
    assert early["false_alarm"] is True
    assert early["detection_time_s"] == 2.0
    assert early["detection_delay_s"] is None
    assert early["isolation_delay_s"] is None
    assert early["isolation_correct"] is False  # the right rotor, but by chance


def test_an_alarm_without_any_fault_is_false():
    assert score(faults=())["false_alarm"] is True
    assert score(faults=(), detection=None, isolation=None)["false_alarm"] is False


@pytest.mark.parametrize("fault", [FAULT | {"onset_s": 99.0}, FAULT | {"loss_of_effectiveness": 0.0}])
def test_a_fault_that_never_takes_effect_is_none(fault):
    assert score(faults=(fault,))["false_alarm"] is True
    assert score(faults=(fault,))["isolation_correct"] is None


@pytest.mark.parametrize("rotor", [0, 1, -1])
def test_any_other_rotor_is_not_correct(rotor):
    assert score(rotor=rotor)["isolation_correct"] is False


def test_isolation_is_open_if_there_is_not_exactly_one_failed_rotor():
    assert score(faults=())["isolation_correct"] is None
    assert score(faults=(FAULT, OTHER))["isolation_correct"] is None
    assert score(faults=(FAULT, FAULT | {"onset_s": 7.0}))["isolation_correct"] is True


def test_delays_count_from_the_first_of_several_onsets():
    assert score(faults=(OTHER, FAULT))["detection_delay_s"] == 0.5


def test_the_first_detection_and_the_last_naming_count():
    time = np.arange(101) * 0.1
    detection = np.select([time >= 8, time >= 4.5], [8.0, 4.5], np.nan)
    isolation = np.select([time >= 9, time >= 5], [9.0, 5.0], np.nan)
    rotor = np.select([time >= 9, time >= 5], [2.0, 3.0], 0.0)
    changed = score(detection_time=detection, isolation_time=isolation, faulty_rotor=rotor)
    assert (changed["detection_time_s"], changed["isolation_time_s"], changed["faulty_rotor"]) == (4.5, 9.0, 2)


def test_rmse_counts_every_rotor_from_the_isolation_on():
    assert score(rotor=3, estimate=0.4)["loe_rmse"] == pytest.approx(0.5)  # 0.3 missing on rotor 2, 0.4 on rotor 3
    late = score(isolation=9.0)
    assert late["loe_rmse"] == pytest.approx(0.02)


def test_the_final_error_is_the_mean_of_the_last_three_seconds():
    time = np.arange(101) * 0.1
    estimate = np.zeros((101, 4))
    estimate[:, 1] = np.where(time >= 9.45, 0.3 + 31 / 6 * 0.06, np.where(time >= 6.95, 0.3, 0.9))
    assert score(loe_estimate=estimate)["loe_final_error"] == pytest.approx(0.06)


def test_the_final_error_does_not_count_what_was_before_the_isolation():
    assert score(isolation=9.0)["loe_final_error"] == pytest.approx(-0.02)


def test_of_several_failed_rotors_the_worst_final_error_is_reported():
    assert score(faults=(FAULT, OTHER))["loe_final_error"] == pytest.approx(-0.1)


def test_the_peak_ratio_ends_at_the_onset_and_leaves_out_the_warm_up():
    assert score(peak=0.9)["peak_residual_ratio_before_fault"] == 0.9
    assert score(faults=(), peak=0.9)["peak_residual_ratio_before_fault"] == 3.0
    assert score(faults=(FAULT | {"onset_s": 0.0},))["peak_residual_ratio_before_fault"] is None


def test_the_largest_of_several_residuals_makes_the_peak():
    residual = np.zeros((101, 3))
    residual[20] = 1.0, -1.2, 0.5
    threshold = np.tile([2.0, 2.0, np.nan], (101, 1))
    assert score(residual=residual, threshold=threshold)["peak_residual_ratio_before_fault"] == 0.6


def test_unknown_truth_leaves_open_what_depends_on_it():
    unknown = score(faults=(), truth=False)
    assert unknown["detection_time_s"] == 4.5
    assert unknown["faulty_rotor"] == 2
    open_figures = ("false_alarm", "detection_delay_s", "isolation_correct", "loe_rmse", "loe_final_error")
    assert [unknown[key] for key in open_figures] == [None] * 5
    assert unknown["peak_residual_ratio_before_fault"] is None  # nobody knows what was before the fault
    assert score(faults=(), truth=False, detection=None)["peak_residual_ratio_before_fault"] == 3.0


def test_a_replay_is_scored_against_declared_faults():
    declared = score(truth=False)
    assert declared["isolation_correct"] is True
    assert declared["loe_final_error"] == pytest.approx(-0.02)
    assert score(truth=False, faults=(FAULT | {"profile": "incipient"},))["loe_final_error"] is None
    assert score(truth=False, faults=(FAULT | {"loss_of_effectiveness": None},))["loe_rmse"] is None


def test_declared_losses_of_one_rotor_combine():
    flown = recording(truth=False, faults=(FAULT, FAULT | {"onset_s": 7.0, "loss_of_effectiveness": 0.5}))
    np.testing.assert_allclose(metrics.true_loss(flown)[[0, 45, 90], 1], [0, 0.3, 0.65])


def test_nan_does_not_spread():
    broken = np.full((101, 4), np.nan)
    broken[:50] = 0.0
    result = score(loe_estimate=broken, residual=np.full((101, 1), np.nan), faulty_rotor=np.full(101, np.nan))
    assert result["loe_estimate"] == [None] * 4
    assert result["loe_rmse"] is None
    assert result["peak_residual_ratio_before_fault"] is None
    assert result["faulty_rotor"] == 0
    assert result["fault_detected"] is True


def test_a_diagnoser_that_says_little_is_scored_for_what_it_says():
    ports = ("residual", "threshold", "loe_estimate", "detection_time", "isolation_time", "faulty_rotor")
    silent = score(**dict.fromkeys(ports))
    assert silent["fault_detected"] is True
    assert silent["false_alarm"] is False
    assert silent["loe_estimate"] == [None] * 4
    assert silent["peak_residual_ratio_before_fault"] is None


def test_scalar_residuals_count_too():
    scalar = np.full(101, 0.8)
    assert score(residual=scalar, threshold=np.full(101, 2.0))["peak_residual_ratio_before_fault"] == 0.4


def test_a_recording_without_diagnosers_has_none():
    flown = recording()
    flown.diagnosers.clear()
    assert metrics.summarise(flown)["diagnosers"] == {}
