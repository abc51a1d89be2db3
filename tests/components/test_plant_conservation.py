"""The plant keeps what mechanics keeps, integrates to fourth order and is blown about as declared."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.spatial.transform import Rotation

STEP = 0.002
INERTIA = np.array([0.022, 0.024, 0.040])
FREE = {"drag_coefficient": 0.0, "gravity": 0.0}
TUMBLING = {"initial_euler": [0.3, -0.2, 1.0], "initial_body_rate": [6.0, 9.0, -4.0]}


def rotation(outputs):
    return Rotation.from_quat(outputs["quaternion"], scalar_first=True)


def test_free_tumbling_keeps_angular_momentum_and_energy(component):
    outputs = component("plant", **FREE, **TUMBLING).initialise().run(5000)
    momentum = rotation(outputs).apply(INERTIA * outputs["body_rate"])
    energy = (INERTIA * outputs["body_rate"] ** 2).sum(axis=1) / 2
    assert np.ptp(outputs["body_rate"], axis=0).min() > 0.9  # it does tumble
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (5001, 1)), atol=1e-8 * np.linalg.norm(momentum[0]))
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_rotors_exchange_momentum_with_the_body_only_as_gyroscopes(component):
    """Opposite rotors at different speeds carry angular momentum; its direction turns with the body."""
    no_torque = {"thrust_coefficient": [1e-12] * 4, "torque_coefficient": [1e-12] * 4}
    speed = np.array([600.0, 500, 600, 500])
    plant = component("plant", **FREE, **TUMBLING, **no_torque).initialise(rotor_speed=speed)
    outputs = plant.run(2500, rotor_speed=np.tile(speed, (2500, 1)))
    rotors = -6e-5 * (speed * [1, -1, 1, -1]).sum() * np.array([0, 0, 1])
    momentum = rotation(outputs).apply(INERTIA * outputs["body_rate"] + rotors)
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (2501, 1)), atol=1e-5 * np.linalg.norm(momentum[0]))


def test_free_fall(component):
    start = {"initial_position": [1, 2, -30], "initial_velocity": [1, -2, -3]}
    outputs = component("plant", drag_coefficient=0.0, **start, **TUMBLING).initialise().run(1000)
    t = STEP * np.arange(1001)[:, None]
    np.testing.assert_allclose(outputs["velocity"], [1, -2, -3] + t * [0, 0, 9.81], atol=1e-10)
    np.testing.assert_allclose(outputs["position"], [1, 2, -30] + t * [1, -2, -3] + t**2 / 2 * [0, 0, 9.81], atol=1e-10)
    np.testing.assert_allclose(outputs["specific_force"], 0, atol=1e-12)


def test_hover_stands_still_and_feels_gravity(component):
    speed = np.full(4, np.sqrt(1.5 * 9.81 / 4 / 1.2e-5))
    outputs = component("plant").initialise(rotor_speed=speed).run(1000, rotor_speed=np.tile(speed, (1000, 1)))
    for output in ("position", "velocity", "euler", "body_rate"):
        np.testing.assert_allclose(outputs[output], 0, atol=1e-9)
    np.testing.assert_allclose(outputs["specific_force"], np.tile([0, 0, -9.81], (1001, 1)), atol=1e-9)


def test_euler_angles_and_quaternion_are_one_attitude(component):
    spinning = {"initial_euler": [0.3, -0.2, 1.0], "initial_body_rate": [60.0, 90.0, -40.0]}
    outputs = component("plant", **FREE, **spinning).initialise().run(1000)
    np.testing.assert_allclose(outputs["euler"][0], spinning["initial_euler"], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(outputs["quaternion"], axis=1), 1, atol=1e-15)
    from_euler = Rotation.from_euler("ZYX", outputs["euler"][:, ::-1])
    assert (from_euler * rotation(outputs).inv()).magnitude().max() < 1e-7


def test_speeds_go_linearly_across_a_step(component):
    """Vertical speed after one step is the integral of a thrust that is quadratic in time."""
    b, m, step, start, end = 1.2e-5, 1.5, 0.01, 400.0, 700.0
    plant = component("plant", step_size=step, drag_coefficient=0.0).initialise(rotor_speed=[start] * 4)
    velocity = plant.run(1, rotor_speed=np.full((1, 4), end))["velocity"][-1]
    mean_square = (start**2 + start * end + end**2) / 3
    np.testing.assert_allclose(velocity, [0, 0, step * (9.81 - 4 * b / m * mean_square)], rtol=1e-12, atol=1e-15)


def test_integration_is_of_fourth_order(component):
    """Halving the substep divides the error by 16."""

    def final(step):
        speed = [600.0, 500, 550, 450]
        plant = component("plant", step_size=step, initial_body_rate=[30.0, 20, -40]).initialise(rotor_speed=speed)
        outputs = plant.run(round(0.4 / step))
        return np.concatenate([outputs[name][-1] for name in ("position", "velocity", "quaternion", "body_rate")])

    exact = final(1e-3 / 16)
    errors = [np.linalg.norm(final(step) - exact) for step in (1e-3, 5e-4, 2.5e-4)]
    np.testing.assert_allclose(np.log2(errors[:-1]) - np.log2(errors[1:]), 4, atol=0.15)


def test_gusts_have_the_declared_statistics(component):
    """Standard deviation, correlation time and limit, over 40,000 steps of 50 ms; clipping rarely acts here."""
    std, time_constant = np.array([0.12, 0.12, 0.06, 0.25, 0.25, 0.03]), np.array([1, 2, 0.5, 0.3, 0.4, 0.2])
    step, steps = 0.05, 40000
    plant = component(
        "plant", step_size=step, gust_std=std, gust_time_constant=time_constant, gust_limit=4 * std, gravity=0.0
    ).initialise()
    gust = plant.run(steps)["disturbance"]
    correlation = (gust[1:] * gust[:-1]).mean(axis=0) / gust.var(axis=0)
    np.testing.assert_allclose(gust.std(axis=0), std, rtol=0.06)
    np.testing.assert_allclose(correlation, np.exp(-step / time_constant), atol=0.01)
    np.testing.assert_allclose(np.corrcoef(gust.T), np.eye(6), atol=0.1)


def test_gusts_are_clipped(component):
    limit = np.array([0.1, 0.2, 0.05, 0.3, 0.2, 0.01])
    gust = component("plant", gust_std=limit, gust_limit=limit).initialise().run(5000)["disturbance"]
    np.testing.assert_array_equal(np.abs(gust).max(axis=0), limit)


def test_gusts_accelerate_the_body_as_shown(component):
    """Without other forces, speed after a step is speed before it plus the shown disturbance times the step."""
    outputs = component("plant", **FREE, gust_std=[0.1, 0.1, 0.1, 0, 0, 0]).initialise().run(100)
    np.testing.assert_allclose(np.diff(outputs["velocity"], axis=0), STEP * outputs["disturbance"][1:, :3], atol=1e-15)
    spun = component("plant", **FREE, gust_std=[0, 0, 0, 0, 0, 0.1]).initialise().run(100)
    np.testing.assert_allclose(np.diff(spun["body_rate"], axis=0), STEP * spun["disturbance"][1:, 3:], atol=1e-15)


def test_calm_by_default(component):
    assert not component("plant").initialise().run(100)["disturbance"].any()


def test_half_a_seed_is_refused(component):
    plant = component("plant", seed=1.5)
    with pytest.raises(FMICallException):
        plant.initialise()
    assert "seed must be a whole number" in " ".join(plant.messages)


def test_a_constant_disturbance_is_added_to_the_clipped_gusts(component):
    push = np.array([0.3, -0.2, 0.1, 0.0, 0.0, 0.5])
    outputs = component("plant", **FREE, constant_disturbance=push).initialise().run(100)
    np.testing.assert_allclose(outputs["disturbance"], np.tile(push, (101, 1)))
    t = STEP * np.arange(101)[:, None]
    np.testing.assert_allclose(outputs["velocity"], t * push[:3], atol=1e-12)
    np.testing.assert_allclose(outputs["body_rate"], t * push[3:], atol=1e-12)
    gusts = {"gust_std": [1.0] * 6, "gust_limit": [0.1] * 6}
    blown = component("plant", **gusts, constant_disturbance=push).initialise().run(2000)["disturbance"]
    np.testing.assert_allclose(np.abs(blown - push).max(axis=0), 0.1)
