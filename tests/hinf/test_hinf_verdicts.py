"""What `hinf` says: which model it used, which rotors lost how much, one or several."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_design
from tests.hinf.flights import DT, hold
from tests.thau.driver import hovering, run

TAU3 = {"fault_model": 1}


@pytest.mark.parametrize("model", [0, 1])
@pytest.mark.parametrize("vehicle", ["lab_x", "ren_plus"])
@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_each_rotor_is_named_with_its_loss(rotor, vehicle, model):
    losses = np.where(np.arange(1, 5) == rotor, 0.3, 0.0)
    found = hold(losses, vehicle=vehicle, fault_model=model)
    assert found["faulty_rotor"][-1] == rotor
    np.testing.assert_allclose(found["loe_estimate"][-1], losses, atol=1e-3)
    assert found["isolation_model"][-1] == (1 if model else 4)


def test_thresholds_are_those_of_the_model():
    design = load_design("lab_x", "hinf")["parameters"]
    for model, port in ((0, "margin"), (1, "torque_margin")):
        threshold = hold([0, 0, 0, 0], duration=1.2, fault_model=model)["threshold"]
        assert np.isnan(threshold[0]).all()
        np.testing.assert_allclose(threshold[-1], design[port])


def test_tau3_names_a_rotor_without_the_vertical_velocity():
    found = hold([0, 0, 0.3, 0], **TAU3)
    assert found["faulty_rotor"][-1] == 3
    assert np.isnan(found["vertical_velocity_estimate"]).all()
    assert np.isnan(found["rotor_loss"]).all()
    assert not found["rotor_lost"].any()
    assert not found["acceleration_fault"][:, 0].any()


def test_one_loss_flags_no_other_rotor():
    for loss in (0.3, 0.6):
        found = hold([loss, 0, 0, 0])
        assert found["rotor_lost"].any(axis=0).tolist() == [1, 0, 0, 0]


def test_vz4_estimates_several_losses_at_once():
    for losses in ([0.3, 0, 0.3, 0], [0.25, 0.35, 0, 0], [0.2, 0.2, 0.2, 0.2]):
        found = hold(losses)
        assert found["faulty_rotor"][-1] == -1
        assert found["rotor_lost"][-1].tolist() == [loss > 0 for loss in losses]
        np.testing.assert_allclose(found["loe_estimate"][-1], losses, atol=2e-3)


def test_vz4_adds_a_second_loss_to_a_named_rotor():
    found = hold([0.3, 0, 0, 0], [0, 0, 0, 0.4], duration=4.0)
    assert found["faulty_rotor"][-1] == 1
    np.testing.assert_allclose(found["loe_estimate"][-1], [0.3, 0, 0, 0.4], atol=2e-3)


def test_a_loss_is_followed_whatever_the_rotor_does():
    """The fault is the loss, not what it takes away: the estimate does not move when only the command does."""
    design = load_design("lab_x", "hinf")["parameters"]
    found = hold([0.3, 0, 0, 0])
    missing = found["fault_estimate"][-1, 0]
    assert missing == pytest.approx(-0.3 / 0.7, abs=2e-3)  # more than 0.3 of hover is gone, as the rotor turns faster
    assert found["rotor_loss"][-1, 0] == pytest.approx(0.3, abs=1e-3)
    expected = np.array(design["rotor_loss_margin"]) * np.array([0.7, 1, 1, 1])
    np.testing.assert_allclose(found["rotor_loss_threshold"][-1], expected, rtol=1e-3)


@pytest.mark.parametrize("model", [0, 1])
def test_rotors_at_rest_leave_no_trace(model):
    time = DT * np.arange(1, 1000)
    inputs = hovering(time, "lab_x")
    inputs[:50, :4] = 0.0
    found = run("hinf", time, inputs, "lab_x", fault_model=model)
    assert np.isfinite(found["acceleration_fault"]).all()
    assert np.abs(found["acceleration_fault"][-1]).max() < 1e-3


@pytest.mark.parametrize("diagnoser", ["hinf", "fast_adaptive"])
def test_yaw_may_jump_by_a_turn(diagnoser):
    time = DT * np.arange(1, 500)
    inputs = hovering(time, "lab_x")
    inputs[:, 9] = 0.5
    inputs[:, 6] = np.remainder(3.0 + 0.5 * time + np.pi, 2 * np.pi) - np.pi
    assert np.ptp(inputs[:, 6]) > 6
    found = run(diagnoser, time, inputs, "lab_x")
    assert np.abs(found["acceleration_fault"]).max() < 1e-3
