"""The discrete steps follow the continuous observers, within the order of what they know between samples."""

import numpy as np
import pytest

from tests.thau import continuous
from tests.thau.continuous import AFTER, BEFORE, STEPPED, Sliding
from tests.thau.driver import run

DURATION = 0.1  # s, before what goes wrong at the start or at the step of the commands is forgotten
GAINS = {"observer_gain": continuous.K.flatten()}
ADAPTATION = {"fault_gain": continuous.F2.flatten(), "learning_rate": continuous.RATE, "leak": continuous.LEAK}
#: so eager that the term moves x_hat by more than the step is wrong
SLIDING = Sliding(
    direction=np.array([0.0, 0.1, 0.0, 1.0, 0.8, 0.6]),
    surface=np.array([2.0, 0.0, 1.0, 60.0, 70.0, 50.0]),
    rate=8.0,
    leak=2.0,
    layer=15.0,
    dead_zone=3.0,
)
SLIDING_PARAMETERS = {
    "disturbance_direction": SLIDING.direction,
    "sliding_surface": SLIDING.surface,
    "sliding_rate": SLIDING.rate,
    "sliding_leak": SLIDING.leak,
    "sliding_gain_max": 1e3,
    "boundary_layer": SLIDING.layer,
    "dead_zone": SLIDING.dead_zone,
}
PARAMETERS = {"thau": GAINS, "adaptive_thau": GAINS | ADAPTATION, "asmto": GAINS | ADAPTATION | SLIDING_PARAMETERS}
SOLVED = {"thau": (False, None), "adaptive_thau": (True, None), "asmto": (True, SLIDING)}


#: at 2 ms; rad/s for thau, for the others rad/s2, of some 50
TOLERANCE = {"thau": 5e-4, "adaptive_thau": 0.02, "asmto": 0.02}


def discrete(diagnoser, dt, y=continuous.measured, stepped=STEPPED, **options):
    """[x_hat, f_hat, n] of the diagnoser at DURATION."""
    time = dt * np.arange(round(DURATION / dt) + 1)
    inputs = np.zeros((len(time), 11))
    inputs[:, :4] = np.where(time[:, None] > stepped + dt / 2, AFTER, BEFORE)  # commanded over the step that ends
    inputs[:, 4:10] = [y(t) for t in time]
    found = run(diagnoser, time, inputs, **PARAMETERS[diagnoser], **options)
    fault = found["torque_fault"][-1] if diagnoser != "thau" else np.zeros(3)
    gain = found["sliding_gain"][-1] if diagnoser == "asmto" else 0.0
    return np.concatenate((found["euler_estimate"][-1], found["body_rate_estimate"][-1], fault, [gain]))


def deviations(diagnoser, dt, y=continuous.measured, stepped=STEPPED, **options):
    """From the continuous observer: x_hat (6), f_hat (3) as the accelerations that they are, n."""
    scale = np.array([1.0] * 6 + [1 / continuous.IX, 1 / continuous.IY, 1 / continuous.IZ, 1.0])
    exact = continuous.solution(DURATION, *SOLVED[diagnoser], y=y, stepped=stepped)
    return np.abs((discrete(diagnoser, dt, y, stepped, **options) - exact) * scale)


def deviation(diagnoser, dt, *arguments, **options):
    """Largest of x_hat and f_hat. (n' has a kink wherever F1 e_y leaves the dead zone.)"""
    return deviations(diagnoser, dt, *arguments, **options)[:9].max()


@pytest.mark.parametrize("diagnoser", PARAMETERS)
def test_the_step_is_of_second_order_in_what_lies_between_samples(diagnoser):
    errors = [deviation(diagnoser, dt) for dt in (0.002, 0.001, 0.0005)]
    assert errors[0] < TOLERANCE[diagnoser]
    assert errors[1] / errors[2] == pytest.approx(4, abs=0.6)


def test_the_sliding_gain_grows_and_forgets_as_it_should():
    assert deviations("asmto", 0.001)[9] < 1e-3
    assert 0.5 < continuous.solution(DURATION, *SOLVED["asmto"])[9] < 1.0


@pytest.mark.parametrize("diagnoser", ["thau", "adaptive_thau"])
def test_the_step_is_of_fourth_order_where_a_line_meets_what_lies_between(diagnoser):
    errors = [deviation(diagnoser, dt, continuous.linearly_measured, stepped=1.0) for dt in (0.004, 0.002)]
    assert errors[0] / errors[1] > 13


@pytest.mark.parametrize("dt", [0.002, 0.0025, 0.004])
@pytest.mark.parametrize("diagnoser", PARAMETERS)
def test_the_paper_rates_and_slower_ones_are_stable(diagnoser, dt):
    time = dt * np.arange(1, round(4 / dt))
    inputs = np.zeros((len(time), 11))
    inputs[:, :4] = np.sqrt(2 * 9.81 / 4 / continuous.B)
    inputs[1, 7:10] = 1.0  # one wrong sample of the gyro
    found = run(diagnoser, time, inputs)
    early, late = (np.abs(found["acceleration_fault"][part]).max() for part in (slice(0, 20), slice(-20, None)))
    assert early > 10
    assert late < 1e-6
