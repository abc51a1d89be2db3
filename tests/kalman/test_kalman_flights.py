"""In flight both diagnosers say the same, say what the textbook filter says, and decide by their covariance."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.stats import chi2

from rotordx.fmus.diagnosers import rotor_losses
from rotordx.fmus.diagnosers.codegen import diagnoser_function
from rotordx.fmus.diagnosers.interface import Command, Measured
from rotordx.fmus.shell.ports import start_values, unflatten, with_starts
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.orchestrator.reproduction.msjfo.filter_costs import Compiled
from tests.kalman.flights import DT, IDS, flown, inputs, replayed
from tests.kalman.packing import unpacked
from tests.kalman.textbook import Filter, System

DESIGN = load_design("lab_x", "askf")["parameters"]
COMMON = ("residual", "loss_estimate", "loss_covariance", "state_estimate", "state_variance", "normalised_innovation")


def of(diagnoser, port, recording=None):
    return (recording or flown()).signals[f"{diagnoser}.{port}"]


@pytest.mark.parametrize("port", COMMON)
def test_both_diagnosers_say_the_same(port):
    np.testing.assert_allclose(of("askf", port), of("msjfo", port), rtol=0, atol=1e-9)


def test_the_loss_is_found():
    for diagnoser in IDS:
        assert of(diagnoser, "faulty_rotor")[-1] == 3
        assert 0 < of(diagnoser, "detection_time")[-1] - 8.0 <= 0.2
        assert of(diagnoser, "loe_estimate")[-1] == pytest.approx([0, 0, 0.2, 0], abs=0.02)


def test_a_flight_through_the_textbook_filter_gives_the_same_estimates():
    """The model of each step in numbers, then plain numpy."""
    recording, u = flown(), inputs(flown())
    body = load_vehicle("lab_x").fill(VehicleParameters)
    cls = with_starts(rotor_losses.FilterParameters, DESIGN)
    own = unflatten(cls, ca.DM(start_values(cls)))
    model = _model_function(own, body)
    filter_ = Filter(*_start(u[0], own, body))
    losses, speed, rate = [], u[0, :4], u[0, 7:10]
    for row in u[1:2000]:
        A, b, E, C, Q, Q_gamma, R, speed = (np.array(value) for value in model(row, speed, rate))
        speed, rate = speed.ravel(), row[7:10]
        filter_.step(System(A, b.ravel(), E, C, Q, Q_gamma, np.diag(R.ravel())), np.array([row[10], *row[7:10]]))
        losses.append(filter_.X[10:])
    np.testing.assert_allclose(of("askf", "loss_estimate", recording)[2:2001], losses, rtol=0, atol=1e-9)


def _model_function(own, body):
    row, speed, rate = ca.SX.sym("row", 11), ca.SX.sym("speed", 4), ca.SX.sym("rate", 3)
    measured = Measured(euler=row[4:7], body_rate=row[7:10], vertical_velocity=row[10])
    state = SimpleNamespace(started=1, rotor_speed=speed, body_rate=rate)
    interval = rotor_losses.known_interval(measured, Command(rotor_speed_command=row[:4]), state, body, DT)
    m = rotor_losses.step_model(interval, own, body, DT)
    matrices = [m.transition, m.drive, m.loss_input, m.measurement, m.process_noise, m.loss_noise]
    results = [ca.densify(ca.SX(r)) for r in (*matrices, m.measurement_noise, interval.rotor_speed)]
    return ca.Function("model", [row, speed, rate], results)


def _start(row, own, body):
    measured = Measured(euler=ca.DM(row[4:7]), body_rate=ca.DM(row[7:10]), vertical_velocity=row[10])
    state, covariance = rotor_losses.first_estimate(measured, own, body)
    P = np.diag(np.full(14, float(own.initial_loss_variance)))
    P[:10, :10] = ca.evalf(ca.SX(covariance)).full()
    return np.concatenate([ca.evalf(ca.SX(state)).full().ravel(), np.zeros(4)]), P


def test_the_threshold_is_margin_and_quantile_of_the_covariance():
    """Of the healthy, level vehicle: signatures by hand from the vehicle file."""
    recording = flown()
    k = 3500  # 7 s: calibrated, healthy
    body = load_vehicle("lab_x").fill(VehicleParameters)
    P = unpacked(of("askf", "loss_covariance")[k])
    speed = recording.signals["controller.rotor_speed_command"][k]
    roll_signature = body.thrust_coefficient * speed**2 * body.rotor_y / body.inertia[0]
    std = np.sqrt(roll_signature @ P @ roll_signature * max(1.0, *of("askf", "innovation_ratio")[k]))
    expected = DESIGN["margin"][1] + DESIGN["detection_quantile"] * std
    assert of("askf", "threshold")[k, 1] == pytest.approx(expected, rel=0.02)  # speed before or behind the motor lag
    assert np.isnan(of("askf", "threshold")[:2400]).all()  # no alarm before calibration


def test_the_gyros_innovations_are_as_large_as_the_covariance_says():
    quiet = flown(gusts=False, loss=0.0)
    squared = of("askf", "normalised_innovation", quiet)[1000:, 1:] ** 2
    n = squared.size
    assert chi2.ppf(1e-4, n) / n <= squared.mean() <= chi2.ppf(1 - 1e-4, n) / n
    assert 0.95 <= squared.mean() <= 1.05


@pytest.mark.parametrize("diagnoser", IDS)
def test_a_fixed_gain_decides_the_same(diagnoser):
    outputs = replayed(diagnoser, flown(), fixed_gain=1.0)
    assert outputs["faulty_rotor"][-1] == 3
    assert abs(outputs["detection_time"][-1] - of(diagnoser, "detection_time")[-1]) <= 0.01
    difference = outputs["loss_estimate"][1000:3900] - of(diagnoser, "loss_estimate")[1001:3901]
    assert np.abs(difference).max() <= 0.004


def test_the_common_mode_step_says_that_it_is_on_and_takes_the_median():
    for diagnoser in IDS:
        on, off = replayed(diagnoser, flown(), common_mode=1.0), replayed(diagnoser, flown(), common_mode=0.0)
        assert np.all(on["common_mode_removed"] == 1)
        assert not np.any(off["common_mode_removed"])
        np.testing.assert_allclose(np.median(off["loss_deviation"], axis=1), on["common_mode_loss"][:, 0], atol=1e-12)
        np.testing.assert_allclose(on["loss_deviation"], off["loss_deviation"] - on["common_mode_loss"], atol=1e-12)
        assert not np.any(on["residual"][:, 0])
        # an equal loss of all rotors of a symmetrical vehicle is no torque but where they turn at different speeds
        np.testing.assert_allclose(on["residual"][2500:3900, 1:], off["residual"][2500:3900, 1:], atol=0.05)
        assert off["residual"][-1, 0] > 0.3  # less thrust: down


@pytest.mark.parametrize("diagnoser", IDS)
def test_single_precision_decides_the_same(diagnoser, tmp_path):
    function = diagnoser_function(diagnoser)
    single = Compiled(function, tmp_path, np.float32, "-O0")
    outputs = replayed(diagnoser, flown(), single)
    assert outputs["faulty_rotor"][-1] == 3
    assert abs(outputs["detection_time"][-1] - of(diagnoser, "detection_time")[-1]) <= DT + 1e-6
    assert np.abs(outputs["loss_estimate"] - of(diagnoser, "loss_estimate")[1:]).max() < 1e-3
