"""From accelerations to a verdict: what holds of every diagnoser that decides so."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotordx.fmus.diagnosers.interface import Clock, DiagnosisOutputs
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.shell.ports import flatten, size, start_values, unflatten
from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains.flight_model import flight_model

DT = 0.002
MARGIN = np.array([0.4, 1.2, 1.2, 0.4])
SIGNATURES = flight_model(load_vehicle("lab_x")).signatures


class Decider:
    """The decision on given estimates, sample by sample."""

    def __init__(self, signatures=SIGNATURES, **changes):
        x, estimate, clock = ca.SX.sym("x", size(DecisionState)), ca.SX.sym("estimate", 4), ca.SX.sym("clock")
        state = unflatten(DecisionState, x)
        values = np.hstack([np.array(start_values(DecisionParameters))])
        parameters = replace(unflatten(DecisionParameters, ca.DM(values)), margin=ca.DM(MARGIN), **changes)
        started = state.offset_samples + state.first_time > 0
        now = Clock(time=clock, dt=DT)
        calibration, deviation, armed = calibrated(estimate, started, state, parameters, now)
        verdict_state, verdict = decide(
            exceeds_margin(deviation, parameters), deviation, armed, ca.SX(signatures), state, parameters, now
        )
        after = DecisionState(**vars(calibration), **vars(verdict_state))
        outputs = ca.vertcat(flatten(verdict, ca.vertcat), deviation)
        self.function = ca.Function("decide", [x, estimate, clock], [flatten(after, ca.vertcat), outputs])
        self.state = np.array(start_values(DecisionState))
        self.count = 0

    def run(self, estimates):
        """Verdict and deviation after the last of some estimates (N, 4)."""
        for estimate in np.atleast_2d(estimates):
            self.count += 1
            state, outputs = self.function(self.state, estimate, self.count * DT)
            self.state, outputs = state.full().ravel(), outputs.full().ravel()
        return unflatten(DiagnosisOutputs, outputs[:-4]), outputs[-4:]


QUICK = {"warm_up_time": 0.02, "calibration_time": 0.04, "settling_time": ca.DM([0.01, 0.01, 0.01, 0.02])}
WINDOW = 30  # samples of warm-up and calibration

unit = st.floats(-1, 1)
disturbances = st.tuples(unit, unit, unit, unit).map(lambda d: 0.999 * MARGIN * np.array(d))
vehicles = st.sampled_from(["lab_x", "f450_plus", "ren_plus", "crazyflie"])


@settings(max_examples=60, deadline=None)
@given(vehicles, st.integers(1, 4), st.floats(0, 1), st.lists(disturbances, min_size=1, max_size=4))
def test_while_the_margins_hold_no_other_rotor_is_named(vehicle, rotor, loss, errors):
    signatures = flight_model(load_vehicle(vehicle)).signatures
    decider = Decider(signatures, **QUICK, doubt_time=0.02)
    decider.run(np.zeros((WINDOW, 4)))
    for error in errors:
        verdict, _ = decider.run(np.tile(loss * signatures[:, rotor - 1] + error, (20, 1)))
        assert verdict.faulty_rotor in (0, rotor)


@settings(max_examples=30, deadline=None)
@given(st.lists(disturbances, min_size=1, max_size=6))
def test_while_the_margins_hold_a_healthy_vehicle_raises_no_alarm(errors):
    decider = Decider(**QUICK)
    decider.run(np.zeros((WINDOW, 4)))
    for error in errors:
        verdict, _ = decider.run(error)
        assert verdict.fault_detected == 0


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_a_loss_of_a_fifth_is_named_with_its_size(rotor):
    decider = Decider(**QUICK)
    decider.run(np.zeros((WINDOW, 4)))
    verdict, _ = decider.run(np.tile(0.2 * SIGNATURES[:, rotor - 1], (30, 1)))
    assert verdict.faulty_rotor == rotor
    np.testing.assert_allclose(verdict.loe_estimate, 0.2 * (np.arange(1, 5) == rotor), atol=1e-12)
    assert verdict.detection_time == pytest.approx((WINDOW + 1) * DT)
    # yaw settles after 20 ms, but roll and pitch tell the rotor after 10 ms, and 20 ms must it last
    assert verdict.isolation_time == pytest.approx(verdict.detection_time + 0.01 + 0.02, abs=1.5 * DT)


def test_two_rotors_at_once_are_no_loss_of_a_single_one():
    decider = Decider(**QUICK, doubt_time=0.05)
    decider.run(np.zeros((WINDOW, 4)))
    verdict, _ = decider.run(np.tile(SIGNATURES @ [0.3, 0.0, 0.3, 0.0], (100, 1)))
    assert verdict.fault_detected == 1
    assert verdict.faulty_rotor == -1
    assert np.isnan(verdict.isolation_time)


def test_a_constant_offset_of_the_healthy_vehicle_is_taken_out():
    offset = np.array([0.5, -2.0, 1.5, 0.3])
    decider = Decider(**QUICK)
    decider.run(np.full((10, 4), 100.0))  # the warm-up does not count
    verdict, deviation = decider.run(np.tile(offset, (100, 1)))
    assert verdict.fault_detected == 0
    np.testing.assert_allclose(deviation, 0, atol=1e-12)
    verdict, _ = decider.run(np.tile(offset + 0.2 * SIGNATURES[:, 2], (30, 1)))
    assert verdict.faulty_rotor == 3


def test_nothing_is_detected_before_calibration_ends():
    decider = Decider(**QUICK)
    verdict, _ = decider.run(np.full((WINDOW, 4), 50.0) * np.linspace(0, 1, WINDOW)[:, None])
    assert verdict.fault_detected == 0


def test_a_verdict_is_latched():
    decider = Decider(**QUICK)
    decider.run(np.zeros((WINDOW, 4)))
    decider.run(np.tile(0.2 * SIGNATURES[:, 1], (30, 1)))
    verdict, _ = decider.run(np.zeros((200, 4)))
    assert (verdict.fault_detected, verdict.faulty_rotor) == (1, 2)


def test_without_calibration_time_there_is_no_offset():
    decider = Decider(warm_up_time=0.01, calibration_time=0.0)
    _, deviation = decider.run(np.full((20, 4), 0.3))
    np.testing.assert_array_equal(deviation, 0.3)
