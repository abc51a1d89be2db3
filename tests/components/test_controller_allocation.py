"""Commanded rotor speeds produce the demanded thrust and torques, or as much of them, in order, as the limits allow."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rotordx.fmus.model_terms.allocation import allocation_rows
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters

ROUNDING = 1e-9


def vectors(size, limit):
    return st.lists(st.floats(-limit, limit), min_size=size, max_size=size).map(np.array)


#: One sample of everything that the controller is told; from a quiet hover to far beyond what it can do.
samples = st.floats(0.01, 1).flatmap(
    lambda violence: st.fixed_dictionaries(
        {
            "position": vectors(3, 3 * violence),
            "velocity": vectors(3, 3 * violence),
            "euler": vectors(3, 0.6 * violence),
            "body_rate": vectors(3, 5 * violence),
            "euler_reference": vectors(3, 0.5 * violence),
            "attitude_mode": st.sampled_from([0, 1]),
        }
    )
)
#: Another frame than that of the vehicle file: every rotor elsewhere, stronger or weaker.
frames = st.fixed_dictionaries(
    {
        "scale_x": vectors(4, 0.2),
        "scale_y": vectors(4, 0.2),
        "scale_thrust": vectors(4, 0.1),
        "centre_of_mass": vectors(2, 0.1),  # of the arm
    }
)


def shaped(vehicle, frame):
    p = load_vehicle(vehicle).parameters
    return {
        "rotor_x": np.array(p["rotor_x"]) * (1 + frame["scale_x"]),
        "rotor_y": np.array(p["rotor_y"]) * (1 + frame["scale_y"]),
        "thrust_coefficient": np.array(p["thrust_coefficient"]) * (1 + frame["scale_thrust"]),
        "centre_of_mass": frame["centre_of_mass"] * p["rotor_x"][0],
    }


def share_of(achieved, demanded):
    """(share, whether the two are in proportion)."""
    share = achieved @ demanded / (demanded @ demanded)
    return share, np.allclose(achieved, share * demanded, atol=ROUNDING * np.abs(demanded).max())


@pytest.mark.parametrize("vehicle", ["lab_x", "crazyflie"])
@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(frame=frames, sample=samples)
def test_demands_are_met_or_cut_in_order(component, vehicle, frame, sample):
    parameters = shaped(vehicle, frame)
    controller = component("controller", vehicle=vehicle, **parameters).initialise()
    controller.step(**sample)
    values = load_vehicle(vehicle).parameters | parameters
    allocation = np.array(
        allocation_rows(VehicleParameters(**{n: values[n] for n in VehicleParameters.__annotations__}))
    )
    speed_range = np.array([values["rotor_speed_min"], values["rotor_speed_max"]])
    least, most = speed_range**2
    tolerance = ROUNDING * most

    squared_speed = controller["rotor_speed_command"] ** 2
    assert (squared_speed >= least - tolerance).all()
    assert (squared_speed <= most + tolerance).all()

    inverse = np.linalg.inv(allocation)
    thrust, torque = controller["thrust_command"][0], controller["torque_command"]
    wanted = {
        "thrust": inverse[:, 0] * thrust,
        "roll_pitch": inverse[:, 1:3] @ torque[:2],
        "yaw": inverse[:, 3] * torque[2],
    }
    if (np.clip(wanted["thrust"], least, most) != wanted["thrust"]).any():
        return  # thrust alone is beyond the limits: nothing more is promised
    achieved = allocation @ squared_speed
    assert achieved[0] == pytest.approx(thrust, rel=1e-9)

    base, saturated = wanted["thrust"], False
    for part, achieved_torque, wanted_torque in (
        ("roll_pitch", achieved[1:3], torque[:2]),
        ("yaw", achieved[3:], torque[2:]),
    ):
        if np.abs(wanted[part]).max() < 1e-6 * most:
            continue
        share, in_proportion = share_of(achieved_torque, wanted_torque)
        assert in_proportion
        assert -1e-6 <= share <= 1 + 1e-6
        more = base + (share + 1e-4) * wanted[part]
        if share < 1 - 1e-6:  # cut, hence not by more than necessary
            assert (more > most).any() or (more < least).any()
            saturated = True
        base = base + share * wanted[part]
    if not saturated:
        np.testing.assert_allclose(achieved[1:], torque, atol=1e-6 * np.abs(torque).max() + 1e-12)


def test_samples_reach_every_case(component):
    """Guards the property above: among its samples are commands within the limits, and cut yaw, roll and thrust."""
    met = {"within": {}, "yaw cut": {"euler_reference": [0, 0, 1.5]}, "all cut": {"body_rate": [15, 15, 0]}}
    cut = {}
    allocation = np.array(allocation_rows(load_vehicle("lab_x").fill(VehicleParameters)))
    for case, sample in met.items():
        controller = component("controller").initialise()
        controller.step(**sample)
        achieved = (allocation @ controller["rotor_speed_command"] ** 2)[1:]
        cut[case] = ~np.isclose(achieved, controller["torque_command"], rtol=1e-6, atol=1e-9)
    assert cut["within"].tolist() == [False, False, False]
    assert cut["yaw cut"].tolist() == [False, False, True]
    assert cut["all cut"].tolist()[:2] == [True, True]


def test_hover_is_commanded_before_the_first_measurement(component):
    controller = component("controller").initialise()
    np.testing.assert_allclose(controller["rotor_speed_command"], np.sqrt(1.5 * 9.81 / 4 / 1.2e-5))
    assert controller["thrust_command"][0] == pytest.approx(1.5 * 9.81)


@pytest.mark.parametrize(
    ("position", "yaw", "expected"),
    [((1, 0, 0), 0, (0, -1)), ((0, 1, 0), 0, (1, 0)), ((1, 0, 0), np.pi / 2, (-1, 0)), ((0, 1, 0), np.pi / 2, (0, -1))],
)
def test_the_outer_loop_tilts_towards_its_reference(component, position, yaw, expected):
    """To the north: nose down; to the east: right side down; turned by the yaw angle."""
    controller = component("controller").initialise()
    controller.step(position_reference=0.1 * np.array(position), euler=[0, 0, yaw], euler_reference=[0, 0, yaw])
    command = controller["euler_command"][:2]
    np.testing.assert_allclose(command, np.arctan(2.2 * 0.1 / 9.81) * np.array(expected), atol=1e-9)


def test_yaw_errors_take_the_short_way(component):
    controller = component("controller").initialise()
    controller.step(euler_reference=[0, 0, 6.1], euler=[0, 0, -0.1])  # 6.1 is -0.183 from the other side
    assert controller["torque_command"][2] < 0


def test_attitude_mode_flies_the_references_and_holds_the_altitude(component):
    controller = component("controller").initialise()
    controller.step(attitude_mode=1, euler_reference=[0.2, -0.1, 0.3], position=[5, 5, 0.1])
    np.testing.assert_array_equal(controller["euler_command"], [0.2, -0.1, 0.3])
    assert controller["thrust_command"][0] > 1.5 * 9.81


def test_integrals_do_not_wind_up_while_tilt_is_limited(component):
    """Ten seconds 20 m away, then there: nothing is left of the wait."""
    controller = component("controller").initialise()
    for _ in range(5000):
        controller.step(position_reference=[20, -20, 0])
    np.testing.assert_allclose(np.abs(controller["euler_command"][:2]), 0.35)
    controller.step(position_reference=[0, 0, 0])
    np.testing.assert_allclose(controller["euler_command"][:2], 0, atol=1e-3)


def test_integrals_take_up_what_is_lost(component):
    """A constant rate error within the limits is integrated: the torque demand grows."""
    controller = component("controller").initialise()
    demands = []
    for _ in range(100):
        controller.step(body_rate=[-0.05, 0, 0])
        demands.append(controller["torque_command"][0])
    assert demands[-1] - demands[49] == pytest.approx(0.022 * 44 * 0.05 * 0.1, rel=0.05)


def test_a_flat_frame_is_refused(component):
    controller = component("controller", rotor_y=[0.0] * 4)
    with pytest.raises(FMICallException):
        controller.initialise()
    assert "rotor_x, rotor_y and rotor_direction" in " ".join(controller.messages)
