"""Sensors err as their parameters say: noise, bias, rate, latency and filter (33)."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy import signal, stats

STEP = 0.002
QUIET = {
    "gyro_noise_std": 0.0,
    "motion_capture_position_noise_std": 0.0,
    "motion_capture_attitude_noise_std": 0.0,
}
BANDWIDTH = 20.0


def truncated_normal(std):
    return stats.truncnorm(-4.5, 4.5, scale=std)


def test_noise_has_the_declared_distribution(component):
    """Standard deviation within 3 %, mean, shape and bound; 90,000 gyro and 18,000 captured samples."""
    bias = np.array([0.01, -0.02, 0.03])
    outputs = component("sensors", gyro_bias=bias, seed=3).initialise().run(30000)
    captures = slice(None, None, 5)
    for values, mean, std in (
        (outputs["body_rate"], bias, 0.02),
        (outputs["position"][captures], 0.0, 0.002),
        (outputs["euler"][captures], 0.0, np.radians(0.2)),
    ):
        error = values - mean
        assert error.std() == pytest.approx(std, rel=0.03)
        assert np.abs(error.mean(axis=0)).max() < 4 * std / np.sqrt(len(error))
        assert np.abs(error).max() <= 4.5 * std
        assert stats.kstest(error.ravel(), truncated_normal(std).cdf).pvalue > 1e-3


def test_noise_is_white_and_independent_between_channels(component):
    outputs = component("sensors").initialise().run(30000)
    gyro, captured = outputs["body_rate"], np.hstack([outputs["position"], outputs["euler"]])[::5]
    for channels in (gyro, captured):
        limit = 4 / np.sqrt(len(channels))
        correlation = np.corrcoef(np.hstack([channels[1:], channels[:-1]]).T)
        assert np.abs(correlation - np.eye(len(correlation))).max() < limit + 1e-3


@pytest.mark.parametrize(("period", "latency"), [(0.01, 0.0), (0.01, 0.01), (0.01, 0.014), (0.004, 0.05), (0.002, 0.1)])
def test_captures_come_at_their_rate_and_latency(component, period, latency):
    """Position k at step k: what is read tells which step it was captured in."""
    sensors = component("sensors", **QUIET, motion_capture_period=period, motion_capture_latency=latency)
    steps, period_steps, latency_steps = 300, round(period / STEP), round(latency / STEP)
    k = np.arange(steps + 1)
    inputs = {"true_position": np.outer(k, [1, 2, 3]), "true_euler": np.outer(k, [-0.1, 0.01, 1e-3])}
    sensors.initialise()
    outputs = sensors.run(steps, **{name: values[1:] for name, values in inputs.items()})
    arrived = (k - latency_steps) // period_steps * period_steps
    for output, truth in (("position", "true_position"), ("euler", "true_euler")):
        np.testing.assert_allclose(outputs[output][arrived >= 0], inputs[truth][arrived[arrived >= 0]])


def test_period_and_latency_off_the_grid_are_rounded_to_it(component):
    sensors = component("sensors", **QUIET, motion_capture_period=0.0071, motion_capture_latency=0.0071)
    position = sensors.initialise().run(40, true_position=np.outer(np.arange(1, 41), np.ones(3)))["position"][:, 0]
    k = np.arange(41)
    np.testing.assert_array_equal(position, np.maximum(k - 4, 0) // 4 * 4)


def test_a_latency_beyond_the_buffer_is_refused(component):
    sensors = component("sensors", motion_capture_period=0.002, motion_capture_latency=0.128)
    with pytest.raises(FMICallException):
        sensors.initialise()
    assert "motion_capture_latency must not exceed 63 times motion_capture_period" in " ".join(sensors.messages)


def test_velocity_is_filter_33_of_the_captured_position(component):
    """The continuous transfer function w0^2 s / (s + w0)^2, simulated by scipy for the held capture."""
    rng = np.random.default_rng(0)
    position = rng.normal(size=(500, 3)).cumsum(axis=0) / 100
    outputs = component("sensors", **QUIET).initialise().run(500, true_position=position)
    filter_33 = signal.cont2discrete(([BANDWIDTH**2, 0], [1, 2 * BANDWIDTH, BANDWIDTH**2]), STEP, method="zoh")
    expected = signal.lfilter(filter_33[0].ravel(), filter_33[1], outputs["position"], axis=0)
    np.testing.assert_allclose(outputs["velocity"], expected, atol=1e-12)
    np.testing.assert_array_equal(outputs["vertical_velocity"][:, 0], outputs["velocity"][:, 2])


def test_a_jump_of_the_position_shows_the_impulse_response_of_f(component):
    velocity = (
        component("sensors", **QUIET, motion_capture_period=STEP)
        .initialise()
        .run(300, true_position=np.ones((300, 3)))["velocity"]
    )
    time = STEP * np.arange(300)
    impulse_response = BANDWIDTH**2 * time * np.exp(-BANDWIDTH * time)
    np.testing.assert_allclose(velocity[1:], np.tile(impulse_response[:, None], 3), atol=1e-12)


@pytest.mark.parametrize("latency", [0.0, 0.01, 0.026])
def test_a_start_in_motion_causes_no_transient(component, latency):
    """From the first sample on, uniform motion looks like uniform motion that has lasted for ever."""
    speed = np.array([0.8, -1.0, 0.5])
    start = np.array([1.0, 2.0, -1.5])
    sensors = component("sensors", **QUIET, motion_capture_latency=latency, initial_velocity=speed)
    sensors.initialise(true_position=start)
    outputs = sensors.run(1000, true_position=start + STEP * np.outer(np.arange(1, 1001), speed))
    velocity = outputs["velocity"]  # ripples at the rate of the captures
    np.testing.assert_allclose(velocity[5:], velocity[:-5], atol=1e-9)
    np.testing.assert_allclose(velocity[:5].mean(axis=0), speed, rtol=2e-3)
    lag = (start + STEP * np.outer(np.arange(1001), speed) - outputs["position"]) / speed
    assert lag.min() == pytest.approx(latency, abs=1e-9)
    assert lag.max() == pytest.approx(latency + 0.008, abs=1e-9)


def test_initial_outputs_show_the_inputs(component):
    sensors = component("sensors", **QUIET).initialise(
        true_position=[1, 2, 3], true_euler=[0.1, 0.2, 0.3], true_body_rate=[1, 2, 3]
    )
    np.testing.assert_array_equal(sensors["position"], [1, 2, 3])
    np.testing.assert_array_equal(sensors["euler"], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(sensors["body_rate"], [1, 2, 3])
    np.testing.assert_array_equal(sensors["velocity"], [0, 0, 0])
