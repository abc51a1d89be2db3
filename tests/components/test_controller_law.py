"""From rest the controller demands what the equations of its README say, written here once more in numpy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

STEP = 0.002
GRAVITY, MASS, INERTIA, DRAG, MOTOR_LAG, LEAD = 9.81, 1.5, np.array([0.022, 0.024, 0.040]), 0.25, 0.03, 1.5
SAMPLE = [f"{name}_reference" for name in ("position", "velocity", "acceleration", "euler")] + [
    "position",
    "velocity",
    "euler",
    "body_rate",
]
BANDWIDTH, GYRO_BANDWIDTH, TILT, VERTICAL = 20.0, 220.0, 0.35, 6.0


def about(axis, angle):
    """Rotation matrix about one axis."""
    return Rotation.from_euler(axis, angle).as_matrix()


def acceleration(x):
    seen = x["velocity_reference"] - 2 / BANDWIDTH * x["acceleration_reference"]
    a = x["acceleration_reference"] + DRAG / MASS * x["velocity_reference"]
    a += [2.2, 2.2, 6.0] * (x["position_reference"] - x["position"]) + [2.4, 2.4, 4.5] * (seen - x["velocity"])
    a[2] = np.clip(a[2], -VERTICAL, VERTICAL)
    return a


def tilt(a, yaw):
    """Roll and pitch of the attitude with this yaw whose z axis points along gravity minus a."""
    down = about("z", yaw).T @ (np.array([0, 0, GRAVITY]) - a)
    roll = np.arcsin(-down[1] / np.linalg.norm(down))
    return np.clip([roll, np.arctan2(down[0], down[2])], -TILT, TILT)


def torque(x, command):
    angle_error = command - x["euler"]
    angle_error[2] = (angle_error[2] + np.pi) % (2 * np.pi) - np.pi
    roll_rate, pitch_rate, yaw_rate = [6.0, 6.0, 2.5] * angle_error + [0, 0, x["yaw_rate_reference"]]
    to_body = about("x", x["euler"][0]).T  # the axes that roll, pitch and yaw turn about, one after the other
    body_rate = [roll_rate, 0, 0] + to_body @ ([0, pitch_rate, 0] + about("y", x["euler"][1]).T @ [0, 0, yaw_rate])
    error = body_rate - (1 - np.exp(-GYRO_BANDWIDTH * STEP)) * x["body_rate"]
    lead = LEAD - (LEAD - 1) * (1 - np.exp(-LEAD * STEP / MOTOR_LAG))
    return INERTIA * lead * [16, 16, 6] * error


@pytest.mark.parametrize("violence", [0.1, 1.0])
def test_the_first_command_follows_the_equations(component, violence):
    rng = np.random.default_rng(0)
    for _ in range(40):
        x = {name: violence * rng.normal(size=3) for name in SAMPLE} | {"yaw_rate_reference": violence * rng.normal()}
        x["euler"][:2] *= 0.5
        controller = component("controller").initialise()
        controller.step(**x)

        a = acceleration(x)
        command = np.append(tilt(a, x["euler"][2]), x["euler_reference"][2])
        upright = max(0.5, np.cos(x["euler"][0]) * np.cos(x["euler"][1]))
        np.testing.assert_allclose(controller["euler_command"], command, atol=1e-12)
        np.testing.assert_allclose(controller["thrust_command"], MASS * (GRAVITY - a[2]) / upright, rtol=1e-12)
        np.testing.assert_allclose(controller["torque_command"], torque(x, command), rtol=1e-9, atol=1e-12)


def test_a_reference_that_the_sensors_show_late_is_no_error(component):
    """Following exactly, the only demand is the acceleration of the reference and its drag."""
    velocity, acceleration = np.array([0.5, -0.8, 0.3]), np.array([0.4, 0.3, -0.2])
    controller = component("controller").initialise()
    controller.step(
        velocity_reference=velocity, acceleration_reference=acceleration, velocity=velocity - 0.1 * acceleration
    )
    demand = acceleration + DRAG / MASS * velocity
    assert controller["thrust_command"][0] == pytest.approx(MASS * (GRAVITY - demand[2]))
    np.testing.assert_allclose(controller["euler_command"][:2], tilt(demand, 0.0))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_integrals_act_at_their_gains(component, axis):
    """Position a little off for 0.2 s: the demand has grown by gain times error times time."""
    controller = component("controller").initialise()
    error = 0.01 * np.eye(3)[axis]
    demands = []
    for _ in range(101):
        controller.step(position_reference=error)
        roll, pitch, _ = controller["euler_command"]
        thrust = controller["thrust_command"][0] / MASS
        demands.append([-GRAVITY * np.tan(pitch), GRAVITY * np.tan(roll), GRAVITY - thrust][axis])
    assert demands[-1] - demands[0] == pytest.approx([0.5, 0.5, 2.5][axis] * 0.01 * 0.2, rel=1e-3)


def test_attitude_mode_leaves_the_horizontal_integrals_alone(component):
    controller = component("controller").initialise()
    for _ in range(500):
        controller.step(attitude_mode=1, position_reference=[1, 1, 0])
    controller.step(attitude_mode=0, position_reference=[0, 0, 0])
    np.testing.assert_allclose(controller["euler_command"][:2], 0, atol=1e-12)
