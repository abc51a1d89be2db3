"""Every trajectory is consistent: velocity and acceleration are the derivatives of the position it asks for."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

STEP = 0.002
#: Parameters that make the trajectories differ from their start values in everything.
TRAJECTORIES = {
    "hover": {"centre": [1, 2, -3], "heading": 0.3},
    "circle": {"centre": [1, 2, -3], "heading": 0.3},
    "ellipse": {"radius": 1.5, "radius_y": 0.7, "angular_rate": -1.1},
    "vertical_sine": {"vertical_amplitude": 0.3, "angular_rate": 3.0},
    "roll_sine": {"roll_amplitude": 0.2, "angular_rate": 2.0},
    "waypoints": {
        "waypoint_count": 5,  # legs limited by speed, yaw rate, yaw rate and acceleration
        "waypoint_x": [0, 2, 2, 0, 0.2] + [0] * 11,
        "waypoint_y": [0, 0, 0.1, 1, 1] + [0] * 11,
        "waypoint_z": [-1, -2, -2, -1, -1] + [0] * 11,
        "waypoint_yaw": [0, 0.1, 3, 6, 6] + [0] * 11,
        "waypoint_hold": 0.25,
    },
}
STARTS = {"at rest before 0.5 s": {"start_time": 0.5, "ramp_time": 2.0}, "in motion": {}}


def flown(component, name, duration=12.0, **parameters):
    reference = component("reference", trajectory=name, **{**TRAJECTORIES[name], **parameters}).initialise()
    return reference.run(round(duration / STEP))


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS.keys())
@pytest.mark.parametrize("name", TRAJECTORIES)
def test_velocity_and_acceleration_are_derivatives_of_the_position(component, name, start):
    outputs = flown(component, name, **start)
    velocity, acceleration = outputs["velocity_reference"], outputs["acceleration_reference"]

    def derivative(values):
        return (values[2:] - values[:-2]) / (2 * STEP)

    np.testing.assert_allclose(derivative(outputs["position_reference"]), velocity[1:-1], atol=1e-4)
    np.testing.assert_allclose(derivative(velocity), acceleration[1:-1], atol=0.05 if name == "waypoints" else 1e-2)
    yaw_rate = derivative(outputs["euler_reference"][:, 2])
    np.testing.assert_allclose(yaw_rate, outputs["yaw_rate_reference"][1:-1, 0], atol=1e-4)


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_a_ramp_starts_from_rest_and_ends_at_full_rate(component, name):
    ramped = flown(component, name, duration=8.0, start_time=1.0, ramp_time=2.0)
    at_once = flown(component, name, duration=8.0)
    before = slice(0, round(1.0 / STEP) + 1)
    assert not ramped["velocity_reference"][before].any()
    assert not ramped["acceleration_reference"][before].any()
    behind = round(2.0 / STEP)  # start_time and half of ramp_time
    after = round(3.0 / STEP)
    for output in ("position_reference", "velocity_reference", "acceleration_reference", "euler_reference"):
        np.testing.assert_allclose(ramped[output][after:], at_once[output][after - behind : -behind], atol=1e-9)


def test_the_circle_is_that_of_the_benchmark_even_after_an_hour(component):
    """Time is absolute: nothing accumulates."""
    start = 3600.0
    outputs = component("reference").initialise(start).run(500)
    t = start + STEP * np.arange(501)
    expected = np.column_stack([np.cos(0.8 * t), np.sin(0.8 * t), np.full(501, -1.5)])
    np.testing.assert_allclose(outputs["position_reference"], expected, atol=1e-11)
    np.testing.assert_allclose(outputs["euler_reference"][:, 2], 0.5 * np.sin(2 * np.pi * t / 12), atol=1e-11)
    assert not outputs["attitude_mode"].any()


def test_the_ellipse_has_its_semi_axes(component):
    t = STEP * np.arange(2001)
    expected = np.column_stack([1.5 * np.cos(-1.1 * t), 0.7 * np.sin(-1.1 * t), np.full(2001, -1.5)])
    np.testing.assert_allclose(flown(component, "ellipse", 4.0)["position_reference"], expected, atol=1e-12)


def test_sines_have_their_amplitude_about_the_hover_point(component):
    t = STEP * np.arange(2001)
    vertical = flown(component, "vertical_sine", 4.0)
    np.testing.assert_allclose(vertical["position_reference"][:, 2], -1.5 + 0.3 * np.sin(3 * t), atol=1e-12)
    roll = flown(component, "roll_sine", 4.0)
    np.testing.assert_allclose(roll["euler_reference"][:, 0], 0.2 * np.sin(2 * t), atol=1e-12)
    assert roll["attitude_mode"].all()
    assert not roll["velocity_reference"].any()


def test_way_points_are_visited_within_the_limits(component):
    limits = {"speed_limit": 0.8, "acceleration_limit": 1.5, "yaw_rate_limit": 0.9}
    outputs = flown(component, "waypoints", duration=20.0, **limits)
    given = TRAJECTORIES["waypoints"]
    points = np.column_stack([given[f"waypoint_{axis}"][:5] for axis in "xyz"])
    yaw = np.array(given["waypoint_yaw"][:5])
    speed = np.linalg.norm(outputs["velocity_reference"], axis=1)
    acceleration = np.linalg.norm(outputs["acceleration_reference"], axis=1)
    for values, limit in (
        (speed, limits["speed_limit"]),
        (acceleration, limits["acceleration_limit"]),
        (np.abs(outputs["yaw_rate_reference"]), limits["yaw_rate_limit"]),
    ):
        assert values.max() == pytest.approx(limit, rel=1e-3)  # some leg is as quick as this limit allows

    resting = speed + np.abs(outputs["yaw_rate_reference"][:, 0]) == 0
    visits = [
        np.flatnonzero(
            resting & (outputs["position_reference"] == point).all(axis=1) & (outputs["euler_reference"][:, 2] == angle)
        )
        for point, angle in zip(points, yaw, strict=True)
    ]
    for visit in visits:
        assert np.ptp(visit) * STEP >= 0.25 - 2 * STEP  # waypoint_hold
    assert [visit[0] for visit in visits] == sorted(visit[0] for visit in visits)
    assert visits[-1][-1] == 10000  # rests at the last one


def test_coinciding_way_points_take_no_time(component):
    outputs = (
        component("reference", trajectory="waypoints", waypoint_x=[1.0] * 16, waypoint_y=[2.0] * 16, waypoint_hold=0.0)
        .initialise()
        .run(10)
    )
    np.testing.assert_array_equal(outputs["position_reference"], np.tile([1, 2, -1.5], (11, 1)))


def test_half_a_way_point_is_refused(component):
    reference = component("reference", waypoint_count=2.5)
    with pytest.raises(FMICallException):
        reference.initialise()
    assert "waypoint_count must be a whole number" in " ".join(reference.messages)
