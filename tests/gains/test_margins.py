"""Margins hold for the diagnosers as they fly, and are not wider than they must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete

from rotordx.fmus.diagnosers.codegen import diagnoser_component, diagnoser_function, start_function
from rotordx.fmus.shell.ports import flatten, start_values, table, with_starts
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains.flight_model import flight_model
from rotordx.gains.margins import responses

DT = 0.002
LEAD_IN = 4000  # samples, until the diagnoser has converged and calibrated
LINEAR = {"hinf": "acceleration_fault", "adaptive_thau": "acceleration_fault", "fast_adaptive": "acceleration_fault"}


class Diagnoser:
    """The step of a diagnoser, as the FMU runs it, fed with motions about hover."""

    def __init__(self, name: str, port: str):
        vehicle = load_vehicle("lab_x")
        component = diagnoser_component(name)
        design = load_design("lab_x", name)["parameters"]
        own = with_starts(component.parameters[-1], design)
        self.step = diagnoser_function(name)
        body = flatten(vehicle.fill(VehicleParameters), lambda *v: np.hstack(v))
        self.numbers = np.hstack([DT, body, start_values(own)])
        self.state = start_function(name)()["x"].full().ravel()
        offsets = np.cumsum([0] + [p.size for p in table(component.outputs)])
        first = offsets[[p.name for p in table(component.outputs)].index(port)]
        self.rows = slice(first, first + 4)
        self.hover = flight_model(vehicle).hover_speed
        self.vehicle, self.name, self.port, self.design = vehicle, name, port, design
        self.run(np.zeros((LEAD_IN, 3)), np.zeros((LEAD_IN, 3)), np.zeros(LEAD_IN))

    def run(self, euler, rate, velocity):
        """Outputs (N, 4) of the port over measurements."""
        inputs = np.hstack([np.tile(self.hover, (len(rate), 1)), euler, rate, velocity[:, None]])
        outputs = np.empty((len(rate), 4))
        for k, u in enumerate(inputs):
            state, y = self.step(self.state, u, 10.0, self.numbers)
            self.state = state.full().ravel()
            outputs[k] = y.full().ravel()[self.rows]
        return outputs

    def responses(self):
        return responses(self.name, self.vehicle, self.design, self.port, DT)

    def moved(self, acceleration):
        """Outputs while unknown accelerations (N, 4) of v_z, p, q, r act, each held for a step."""
        bandwidth = self.vehicle.fill(SensorParameters).velocity_filter_bandwidth
        body = self.vehicle.fill(VehicleParameters)
        # v_z with drag, through w0^2 / (s + w0)^2, the acceleration held: an independent discretisation of the chain
        chain = np.array(
            [[-body.drag_coefficient / body.mass, 0, 0], [bandwidth, -bandwidth, 0], [0, bandwidth, -bandwidth]]
        )
        system = (chain, np.array([[1.0], [0], [0]]), np.eye(3), np.zeros((3, 1)))
        A, B, *_ = cont2discrete(system, DT)
        x, velocity = np.zeros(3), np.empty(len(acceleration))
        for k, a in enumerate(acceleration[:, 0]):
            x = A @ x + B[:, 0] * a
            velocity[k] = x[2]
        rate = np.cumsum(acceleration[:, 1:], axis=0) * DT
        euler = np.cumsum(rate - acceleration[:, 1:] * DT / 2, axis=0) * DT
        return self.run(euler, rate, velocity)


@pytest.fixture(scope="module", params=list(LINEAR))
def diagnoser(request):
    return request.param


def fresh(name):
    return Diagnoser(name, LINEAR[name])


def test_the_worst_accelerations_reach_the_peak_gain_and_no_more(diagnoser):
    """Bang-bang against the reversed impulse response is what the L1 norm is attained by."""
    found = fresh(diagnoser).responses()
    gain = found.peak_gain()
    for channel in np.flatnonzero(gain.diagonal()):
        response = found.accelerations[:1500, channel, channel]
        worst = np.zeros((1500, 4))
        worst[:, channel] = 0.01 * np.sign(response[::-1])  # small: within the linear range
        reached = fresh(diagnoser).moved(worst)[-1, channel]
        assert reached == pytest.approx(0.01 * gain[channel, channel], rel=0.03)
        assert reached <= 0.01 * gain[channel, channel] * 1.01


def test_random_accelerations_stay_within(diagnoser):
    rng = np.random.default_rng(1)
    bound = 0.01 * np.array([0.3, 1.0, 1.0, 0.3])  # small: within the linear range
    one = fresh(diagnoser)
    peak = one.responses().peak_gain() @ bound
    moved = one.moved(np.repeat(rng.choice([-1.0, 1.0], (60, 4)), 25, axis=0) * bound)
    assert np.all(np.abs(moved) <= peak * 1.01 + 1e-12)


def test_noise_leaves_the_predicted_deviation(diagnoser):
    rng = np.random.default_rng(2)
    one = fresh(diagnoser)
    sensors = one.vehicle.fill(SensorParameters)
    count, held = 6000, round(sensors.motion_capture_period / DT)
    attitude = np.repeat(rng.standard_normal((count // held, 3)), held, axis=0)
    attitude *= sensors.motion_capture_attitude_noise_std
    rate = rng.standard_normal((count, 3)) * sensors.gyro_noise_std
    seen = one.run(attitude, rate, np.zeros(count))[1000:, 1:].std(axis=0)
    found = one.responses()
    predicted = replace(found, position=np.zeros_like(found.position)).noise_std(sensors)[1:]
    np.testing.assert_allclose(seen, predicted, rtol=0.15)
