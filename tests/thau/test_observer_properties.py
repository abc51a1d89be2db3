"""What holds of the three observers in any flight."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_design
from tests.thau.driver import DIAGNOSERS, hovering, run

DT = 0.002
QUICK = {"warm_up_time": 0.2, "calibration_time": 0.3}


def accelerated(acceleration, duration=2.0, start=0.0, yaw=0.0):
    """Time and inputs of a vehicle that an unknown constant acceleration (3) turns from a time on."""
    time = DT * np.arange(1, round(duration / DT) + 1)
    since = np.maximum(time - start, 0.0)[:, None]
    inputs = hovering(time)
    inputs[:, 4:7] = since**2 / 2 * acceleration + [0.0, 0.0, yaw]
    inputs[:, 7:10] = since * acceleration
    return time, inputs


@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_a_vehicle_that_does_as_the_model_has_no_residual_from_the_first_sample_on(diagnoser):
    time = DT * np.arange(1, 1000)
    found = run(diagnoser, time, hovering(time))
    assert np.abs(found["residual"]).max() < 1e-9


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_an_unknown_constant_torque_is_read(diagnoser, axis):
    acceleration = 0.05 * np.eye(3)[axis]  # so little that the angles stay small
    found = run(diagnoser, *accelerated(acceleration))
    read, torque = found["acceleration_fault"][-1], found["torque_fault"][-1]
    assert read[1:] == pytest.approx(acceleration, abs=1e-3)
    assert torque == pytest.approx(np.array([0.0035, 0.0035, 0.005]) * acceleration, abs=5e-6)
    assert read[0] == 0


@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_yaw_may_jump_by_a_turn(diagnoser):
    turning = np.array([0.0, 0.0, 0.3])
    near_zero = run(diagnoser, *accelerated(turning))
    time, inputs = accelerated(turning, yaw=3.0)  # crosses pi
    inputs[:, 6] = np.arctan2(np.sin(inputs[:, 6]), np.cos(inputs[:, 6]))
    assert np.abs(np.diff(inputs[:, 6])).max() > 6
    across_pi = run(diagnoser, time, inputs)
    assert across_pi["acceleration_fault"] == pytest.approx(near_zero["acceleration_fault"], abs=1e-9)
    assert np.abs(across_pi["euler_estimate"]).max() <= np.pi


@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_a_constant_disturbance_of_the_healthy_vehicle_is_calibrated_away(diagnoser):
    found = run(diagnoser, *accelerated(np.array([0.1, -0.07, 0.05])), **QUICK)
    later = np.isfinite(found["threshold"][:, 0])
    assert later.sum() == 750  # of 2 s all but warm-up and calibration
    assert np.abs(found["residual"][later]).max() < 0.015
    assert not found["fault_detected"].any()


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_the_lost_thrust_of_a_named_rotor_is_in_newtons(diagnoser, rotor):
    time = DT * np.arange(1, 1001)
    inputs = hovering(time)
    # the failed rotor is commanded more, so that the vehicle stays where it is
    inputs[time > 1.0, rotor - 1] /= np.sqrt(1 - 0.3)
    found = run(diagnoser, time, inputs, **QUICK)
    lost = 2.0 * 9.81 / 4 * 0.3 / 0.7
    expected = -lost * (np.arange(1, 5) == rotor)
    assert found["faulty_rotor"][-1] == rotor
    assert found["loe_estimate"][-1] == pytest.approx(0.3 * (np.arange(1, 5) == rotor), abs=0.002)
    assert found["motor_offset"][-1] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("diagnoser", DIAGNOSERS)
def test_losses_about_two_axes_are_named_as_no_single_rotor(diagnoser):
    time = DT * np.arange(1, 2001)
    inputs = hovering(time)
    inputs[time > 1.0, 0] /= np.sqrt(1 - 0.3)  # front
    inputs[time > 1.0, 2] /= np.sqrt(1 - 0.3)  # left
    found = run(diagnoser, time, inputs, **QUICK)
    lost = 2.0 * 9.81 / 4 * 0.3 / 0.7
    assert found["faulty_rotor"][-1] == -1
    assert found["torque_fault"][-1] == pytest.approx([-0.225 * lost, -0.225 * lost, 0.0], abs=0.003)


def test_thau_sees_large_faults_at_once_and_small_ones_after_a_while():
    margins = load_design("f450_plus", "thau")["parameters"]
    fast, slow = margins["fast_margin"][1], margins["margin"][1]
    assert slow < 0.25 * fast
    for acceleration, least, most in ((5 * fast, 0.0, 0.006), (3 * slow, 0.02, 0.2)):
        assert not 3 * slow > fast
        time, inputs = accelerated(np.array([acceleration, 0.0, 0.0]), duration=1.3, start=1.0)
        found = run("thau", time, inputs, **QUICK)
        assert 1.0 + least < found["detection_time"][-1] < 1.0 + most
