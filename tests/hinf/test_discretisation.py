"""The discrete steps follow the continuous observers, to second order in what lies between samples."""

import numpy as np
import pytest

from tests.hinf import continuous
from tests.hinf.continuous import AFTER, BEFORE, HOVER, STEPPED
from tests.thau.driver import hovering, run

DURATION = 0.4
#: at a step of 2 ms: rad, rad/s, m/s, and faults in units of one rotor's total loss
TOLERANCE = 1e-5
PARAMETERS = {
    "vz4": {"observer_gain": continuous.VZ4_GAIN.flatten(), "fault_model": 0},
    "tau3": {"torque_observer_gain": continuous.TAU3_GAIN.flatten(), "fault_model": 1},
    "fast_adaptive": {"observer_gain": continuous.L.flatten(), "fault_gain": continuous.F.flatten()},
}


def diagnoser_of(observer):
    return "fast_adaptive" if observer == "fast_adaptive" else "hinf"


def exact(observer):
    """Estimated attitude, rates, v_z (of vz4) and fault of the continuous observer at the end."""
    y = continuous.measured(0.0)
    if observer == "vz4":
        start = [*y, 2 / continuous.W0 * y[6], y[6], *np.zeros(4)]
        z = continuous.solution(continuous.vz4, start, DURATION)
        effort = (continuous.rotor_speed(DURATION) / HOVER) ** 2
        return np.concatenate((z[:6], z[8:9], effort * z[9:]))
    z = continuous.solution(getattr(continuous, observer), [*y[:6], 0, 0, 0], DURATION)
    if observer == "fast_adaptive":
        error = z[:6] - continuous.measured(DURATION)[:6]
        return np.concatenate((z[:6], continuous.fast_fault(error, z[6:]) / continuous.J / continuous.SCALE))
    return z


def discrete(observer, dt):
    """The same of the diagnoser."""
    time = dt * np.arange(round(DURATION / dt) + 1)
    inputs = np.zeros((len(time), 11))
    inputs[:, :4] = np.where(time[:, None] > STEPPED + dt / 2, AFTER, BEFORE)  # commanded over the step that ends
    inputs[:, 4:] = [continuous.measured(t) for t in time]
    found = run(diagnoser_of(observer), time, inputs, "lab_x", **PARAMETERS[observer])
    state = [*found["euler_estimate"][-1], *found["body_rate_estimate"][-1]]
    if observer == "vz4":
        return np.array([*state, found["vertical_velocity_estimate"][-1], *found["fault_estimate"][-1]])
    if observer == "tau3":
        return np.array([*state, *found["fault_estimate"][-1][:3]])
    return np.array([*state, *(found["acceleration_fault"][-1][1:] / continuous.SCALE)])


def deviation(observer, dt):
    return np.abs(discrete(observer, dt) - exact(observer)).max()


@pytest.mark.parametrize("observer", PARAMETERS)
def test_the_step_is_of_second_order(observer):
    errors = [deviation(observer, dt) for dt in (0.004, 0.002, 0.001)]
    assert errors[1] < TOLERANCE
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.8)
    assert errors[1] / errors[2] == pytest.approx(4, abs=0.4)


@pytest.mark.parametrize("dt", [0.002, 0.0025, 0.004])
@pytest.mark.parametrize("observer", PARAMETERS)
@pytest.mark.parametrize("vehicle", ["lab_x", "ren_plus", "f450_plus", "crazyflie"])
def test_the_designs_are_stable_at_all_usual_steps(vehicle, observer, dt):
    time = dt * np.arange(1, round(4 / dt))
    inputs = hovering(time, vehicle)
    inputs[1, 7:10] = 1.0  # one wrong sample of the gyro
    model = {} if observer == "fast_adaptive" else {"fault_model": int(observer == "tau3")}
    found = run(diagnoser_of(observer), time, inputs, vehicle, **model)
    early, late = (np.abs(found["acceleration_fault"][part]).max() for part in (slice(0, 20), slice(-20, None)))
    assert early > 0.5
    assert late < 1e-6
