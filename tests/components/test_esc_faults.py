"""The ESC weakens a rotor exactly as its fault slots say, and its motors lag exactly."""

from decimal import Decimal

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

STEP = 0.002
SLOTS = 8


def slots(*faults, **parameters):
    """Parameters of the ESC from one dictionary per fault; keys without `fault_`."""
    names = {name for fault in faults for name in fault}
    fill = {"rotor": 0.0, "end": 1e9, "on_time": 1.0, "off_time": 1.0}
    arrays = {
        f"fault_{name}": [fault.get(name, fill.get(name, 0.0)) for fault in faults]
        + [fill.get(name, 0.0)] * (SLOTS - len(faults))
        for name in names
    }
    return arrays | parameters


def expected_loss(fault, time):
    """Closed form of one slot at grid instants (onsets and switching instants lie on the grid)."""
    age = np.round((time - fault["onset"]) / STEP) * STEP
    magnitude = fault["magnitude"]
    if fault["profile"] == 1:
        loss = magnitude * (1 - np.exp(-fault["growth_rate"] * age))
    elif fault["profile"] == 2:
        sine = fault["sine_amplitude"] * np.sin(fault["sine_rate"] * age + fault["sine_phase"])
        loss = np.clip(magnitude + fault["slope"] * age + sine, 0, 0.99)
    elif fault["profile"] == 3:
        period = round((fault["on_time"] + fault["off_time"]) / STEP)
        loss = np.where(np.round(age / STEP) % period < round(fault["on_time"] / STEP), magnitude, 0)
    else:
        loss = np.full_like(age, magnitude)
    return np.where((age > -STEP / 2) & (time < fault["end"] - STEP / 2), loss, 0)


def random_fault(rng, profile):
    def grid(low, high):
        return STEP * rng.integers(round(low / STEP), round(high / STEP))

    return {
        "rotor": rng.integers(1, 5),
        "profile": profile,
        "onset": grid(0, 1),
        "end": grid(1.5, 3),
        "magnitude": rng.uniform(0, 0.5),
        "growth_rate": rng.uniform(0.1, 5),
        "slope": rng.uniform(-0.5, 0.5),
        "sine_amplitude": rng.uniform(0, 0.5),
        "sine_rate": rng.uniform(0, 10),
        "sine_phase": rng.uniform(-3, 3),
        "on_time": grid(0.01, 0.3),
        "off_time": grid(0.01, 0.3),
    }


@pytest.mark.parametrize("seed", range(10))
def test_eight_slots_combine_to_their_closed_form(component, seed):
    rng = np.random.default_rng(seed)
    faults = [random_fault(rng, profile) for profile in (0, 1, 2, 3, *rng.integers(0, 4, SLOTS - 4))]
    steps = 1000
    flown = component("esc", **slots(*faults)).initialise().run(steps)["loss_of_effectiveness"][1:]

    time = STEP * np.arange(steps)  # a loss acts from the start of a step
    expected = np.ones((steps, 4))
    for fault in faults:
        expected[:, fault["rotor"] - 1] *= 1 - expected_loss(fault, time)
    np.testing.assert_allclose(flown, 1 - expected, atol=1e-8)


@pytest.mark.parametrize(("step", "onset_steps"), [(0.002, [1, 333, 777]), (0.0003, [5, 9, 10, 11, 17])])
def test_an_abrupt_fault_acts_from_the_very_step_of_its_onset(component, step, onset_steps):
    """Also where k * step falls short of the onset by rounding, as most multiples of 0.0003 do."""
    for onset_step in onset_steps:
        onset = float(onset_step * Decimal(str(step)))
        esc = component("esc", step_size=step, **slots({"rotor": 2, "onset": onset, "magnitude": 0.2})).initialise()
        loss = esc.run(onset_step + 2)["loss_of_effectiveness"][1:, 1]
        np.testing.assert_array_equal(np.flatnonzero(loss), [onset_step, onset_step + 1])
        assert loss[-1] == pytest.approx(0.2, rel=1e-15)


def test_thrust_is_lost_in_proportion_to_the_loss(component):
    esc = component("esc", **slots({"rotor": 3, "magnitude": 0.2}))
    esc.initialise(rotor_speed_command=[500.0] * 4)
    speed = esc.run(500)["rotor_speed"][-1]
    np.testing.assert_allclose((speed / 500) ** 2, [1, 1, 0.8, 1], rtol=1e-6)


def test_the_lag_is_the_exact_exponential(component):
    esc = component("esc", motor_time_constant=0.04).initialise(rotor_speed_command=[300, 400, 500, 600])
    command = np.array([700, 600, 500, 400.0])
    speed = esc.run(100, rotor_speed_command=np.tile(command, (100, 1)))["rotor_speed"]
    decay = np.exp(-STEP * np.arange(101) / 0.04)[:, None]
    np.testing.assert_allclose(speed, command + decay * ([300, 400, 500, 600] - command), rtol=1e-12)


def test_commands_are_clipped_and_faults_are_not(component):
    """A weakened rotor turns slower than the smallest speed that can be commanded."""
    esc = component("esc", **slots({"rotor": 1, "magnitude": 0.36})).initialise()
    speed = esc.run(1000, rotor_speed_command=np.tile([0, 50, 500, 2000.0], (1000, 1)))["rotor_speed"][-1]
    np.testing.assert_allclose(speed, [0.8 * 120, 120, 500, 950], rtol=1e-9)


def test_battery_sag_takes_thrust_from_all_rotors(component):
    start, rate = 60.0, 0.01 / 60
    esc = component("esc", battery_sag_rate=rate, motor_time_constant=1e-6).initialise(start)
    speed = esc.run(1, rotor_speed_command=np.full((1, 4), 500.0))["rotor_speed"][-1]
    np.testing.assert_allclose((speed / 500) ** 2, 1 - rate * start, rtol=1e-12)


def test_motors_start_at_the_commanded_speed(component):
    esc = component("esc").initialise(rotor_speed_command=[501, 502, 503, 504])
    np.testing.assert_array_equal(esc["rotor_speed"], [501, 502, 503, 504])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (slots({"rotor": 1.5}), "fault_rotor must hold whole numbers"),
        (slots({"rotor": 5}), "fault_rotor"),
        (slots({"profile": 0.5}), "fault_profile must hold whole numbers"),
        (slots({"magnitude": 1.5}), "fault_magnitude"),
        (slots({"profile": 3, "on_time": 0.0, "off_time": 0.0}), "must not both be 0"),
        ({"rotor_speed_min": 1000.0}, "rotor_speed_min must be below rotor_speed_max"),
    ],
)
def test_impossible_parameters_are_refused_in_a_sentence(component, parameters, message):
    esc = component("esc")
    with pytest.raises(FMICallException):  # at once, or where parameters are seen together
        esc.initialise(**parameters)
    assert message in " ".join(esc.messages)
