"""The five components together fly: they follow every trajectory, well damped, in gusts and with a weakened rotor."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.spread import perturbed

STEP = 0.002
GUSTS = {"gust_std": [0.12, 0.12, 0.06, 0.25, 0.25, 0.03]}
QUIET = {
    "gyro_noise_std": 0.0,
    "motion_capture_position_noise_std": 0.0,
    "motion_capture_attitude_noise_std": 0.0,
}


def fly(component, duration, vehicle="lab_x", specimen=None, **parameters):
    """Position, its reference and Euler angles (steps, 3) of a flight.

    The controller knows the `vehicle`; what flies is the `specimen`, if there is one. `parameters` has one dictionary
    per component.
    """

    def own(name):
        return parameters.get(name, {})

    flying = specimen or vehicle
    reference = component("reference", **own("reference")).initialise()
    start = {
        "initial_position": reference["position_reference"],
        "initial_velocity": reference["velocity_reference"],
        "initial_euler": [0, 0, reference["euler_reference"][2]],
    } | own("plant")
    controller = component("controller", vehicle, **own("controller")).initialise()
    esc = component("esc", flying, **own("esc")).initialise(rotor_speed_command=controller["rotor_speed_command"])
    plant = component("plant", flying, **start).initialise(rotor_speed=esc["rotor_speed"])

    def truth():
        return {f"true_{name}": plant[name] for name in ("position", "euler", "body_rate")}

    sensors = component("sensors", flying, initial_velocity=start["initial_velocity"], **own("sensors"))
    sensors.initialise(**truth())

    history = []
    for _ in range(round(duration / STEP)):
        measured = sensors.read()
        del measured["vertical_velocity"]
        controller.step(**reference.read(), **measured)
        esc.step(rotor_speed_command=controller["rotor_speed_command"])
        plant.step(rotor_speed=esc["rotor_speed"])
        sensors.step(**truth())
        reference.step()
        history.append((plant["position"], reference["position_reference"], plant["euler"]))
    return (np.array(column) for column in zip(*history, strict=True))


def distance(position, reference):
    return np.linalg.norm(position - reference, axis=1)


@pytest.mark.parametrize("vehicle", ["lab_x", "crazyflie"])
@pytest.mark.parametrize(
    ("trajectory", "bar"),
    [
        ({"trajectory": "hover"}, 0.2),
        ({"trajectory": "circle"}, 0.25),
        ({"trajectory": "ellipse"}, 0.25),
        ({"trajectory": "vertical_sine", "angular_rate": 2.0}, 0.2),
        ({"trajectory": "vertical_sine", "angular_rate": 3.0}, 0.2),
        ({"trajectory": "waypoints"}, 0.3),
    ],
    ids=lambda value: "-".join(map(str, value.values())) if isinstance(value, dict) else "",
)
def test_trajectories_are_followed_in_gusts(component, vehicle, trajectory, bar):
    position, reference, _ = fly(component, 8.0, vehicle, reference=trajectory, plant=GUSTS)
    assert distance(position, reference).max() < bar


def test_a_circle_from_rest_is_followed(component):
    position, reference, _ = fly(component, 8.0, reference={"ramp_time": 3.0}, plant=GUSTS)
    assert distance(position, reference).max() < 0.25


@pytest.mark.parametrize("rate", [2.0, 3.0])
def test_roll_sines_are_followed_at_constant_altitude(component, rate):
    """A phase lag is allowed, the amplitude of 10 degrees is not lost."""
    position, _, euler = fly(component, 8.0, reference={"trajectory": "roll_sine", "angular_rate": rate}, plant=GUSTS)
    assert np.degrees(np.abs(euler[2000:, 0]).max()) == pytest.approx(10, abs=1.5)
    assert np.abs(euler[:, 1:]).max() < np.radians(2)
    assert np.abs(position[:, 2] + 1.5).max() < 0.1


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
def test_40_percent_loss_in_one_rotor_is_survived(component, rotor):
    """On a specimen of lab_x, in gusts: back on the circle 6 s after the loss."""
    specimen = perturbed(load_vehicle("lab_x"), np.random.default_rng(rotor))
    fault = {"fault_rotor": [rotor] + [0] * 7, "fault_onset": [2.0] * 8, "fault_magnitude": [0.4] * 8}
    position, reference, euler = fly(component, 10.0, specimen=specimen, esc=fault, plant=GUSTS)
    error = distance(position, reference)
    assert error.max() < 0.6
    assert error[4000:].max() < 0.3
    assert np.degrees(np.abs(euler[:, :2]).max()) < 20


@pytest.mark.parametrize(("vehicle", "overshoot"), [("lab_x", 0.05), ("crazyflie", 0.05)])
def test_the_attitude_loop_is_well_damped(component, vehicle, overshoot):
    """Released at 0.3 rad of roll, or yaw, the vehicle comes back without swinging far to the other side."""
    for axis in (0, 2):
        released = np.zeros(3)
        released[axis] = 0.3
        _, _, euler = fly(
            component,
            3.0,
            vehicle,
            reference={"trajectory": "roll_sine", "roll_amplitude": 0.0},
            plant={"initial_euler": released},
            sensors=QUIET,
        )
        assert -euler[:, axis].min() < overshoot * 0.3
        assert np.abs(euler[-1]).max() < 0.005


def test_position_steps_are_well_damped(component):
    for axis, overshoot in ((0, 0.25), (2, 0.25)):
        away = np.array([0, 0, -1.5])
        away[axis] += 0.5
        position, reference, _ = fly(
            component, 8.0, reference={"trajectory": "hover"}, plant={"initial_position": away}, sensors=QUIET
        )
        assert -(position - reference)[:, axis].min() < overshoot * 0.5
        assert distance(position, reference)[-1] < 0.05
