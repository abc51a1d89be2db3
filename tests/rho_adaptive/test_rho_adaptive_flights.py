"""Both diagnosers in closed loop on lab_x: paper 003's faults, small errors in still air, every step size."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_design
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.metrics import summarise
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System

DIAGNOSERS = ["rho_adaptive", "smo"]


def scored(recording):
    return summarise(recording)["diagnosers"]


@pytest.mark.parametrize(("scenario", "latest"), [("rho_adaptive_abrupt", 10.35), ("rho_adaptive_incipient", 17.1)])
def test_the_faults_of_the_paper_are_found(scenario, latest):
    for name, score in scored(fly(load_scenario(scenario))).items():
        assert score["isolation_correct"], name
        assert score["detection_time_s"] <= latest
        assert abs(score["loe_final_error"]) < 0.02
        assert score["peak_residual_ratio_before_fault"] < 0.9


@pytest.mark.parametrize("step_size", [0.0025, 0.004])
def test_other_step_sizes_find_the_fault_as_well(step_size):
    scenario = load_scenario("rho_adaptive_abrupt", step_size_s=step_size, duration_s=16.0)
    for name, score in scored(fly(scenario)).items():
        assert score["isolation_correct"], name
        assert score["detection_delay_s"] < 0.2


def test_in_still_air_the_estimates_are_as_good_as_the_noise_allows():
    scenario = load_scenario("rho_adaptive_abrupt", gusts=False)
    with System(scenario) as system:
        for rotor in (1, 2, 3, 4):
            fault = {"rotor": rotor, "onset_s": 10.0, "loss_of_effectiveness": 0.2}
            recording = fly(scenario.changed(faults=[fault], duration_s=24.0), system)
            late = recording.time > 14.0
            for name, largest in (("rho_adaptive", 5e-6), ("smo", 2e-5)):
                estimate = recording.signals[f"{name}.loe_estimate"][late, rotor - 1]
                assert np.mean((estimate - 0.2) ** 2) <= largest


def test_the_estimate_is_of_all_four_rotors():
    scenario = load_scenario("rho_adaptive_abrupt", gusts=False, sensor_noise=False, duration_s=24.0)
    faults = [{"rotor": r, "onset_s": 10.0, "loss_of_effectiveness": loss} for r, loss in ((1, 0.25), (3, 0.3))]
    recording = fly(scenario.changed(faults=faults))
    found = recording.signals["rho_adaptive.fault_estimate"][-1]
    np.testing.assert_allclose(found, [0.25, 0.0, 0.3, 0.0], atol=5e-3)


def test_noise_alone_leaves_in_j_nu_what_the_certificate_says():
    recording = fly(load_scenario("hover", diagnosers=["rho_adaptive"], gusts=False, faults=[], duration_s=60.0))
    residual = recording.signals["rho_adaptive.residual"][recording.time > 6.0]
    design = load_design("lab_x", "rho_adaptive")
    noise = next(c for c in design["certificates"] if c["name"] == "noise")
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(noise["figures"]["mean_rms"], rel=0.03)
    assert 0.8 < residual.max() / design["parameters"]["noise_rms"] < 1
