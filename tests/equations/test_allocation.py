"""One allocation serves every geometry: it equals the corrected matrices of the papers."""

import dataclasses

import numpy as np
import pytest
from casadi import DM, SX

from rotordx.fmus.model_terms import terms
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters

L, B, K = 0.3, 1.3e-5, 2.1e-7


def matrix(vehicle):
    return np.array(DM(terms.allocation(vehicle)))


@pytest.fixture
def lab_x():
    return load_vehicle("lab_x").fill(VehicleParameters)


def plus(vehicle, x, y, direction):
    """The vehicle as a plus frame with arms L, thrust coefficient B and torque coefficient K."""
    return dataclasses.replace(
        vehicle,
        rotor_x=L * np.array(x),
        rotor_y=L * np.array(y),
        rotor_direction=np.array(direction),
        thrust_coefficient=np.full(4, B),
        torque_coefficient=np.full(4, K),
    )


def test_x_frame_of_paper_000(lab_x):
    b, k, a = 1.2e-5, 2e-7, 0.225 / np.sqrt(2)
    printed = [[b, b, b, b], [b * a, -b * a, -b * a, b * a], [b * a, b * a, -b * a, -b * a], [k, -k, k, -k]]
    np.testing.assert_allclose(matrix(lab_x), printed, rtol=1e-15)


def test_plus_frame_of_paper_001(lab_x):
    """(4) with the arm L that it lost in print."""
    vehicle = plus(lab_x, x=(1, -1, 0, 0), y=(0, 0, -1, 1), direction=(1, 1, -1, -1))
    corrected = [[B, B, B, B], [0, 0, B * L, -B * L], [B * L, -B * L, 0, 0], [K, K, -K, -K]]
    np.testing.assert_allclose(matrix(vehicle), corrected, rtol=1e-15)


def test_gyroscopic_torque_of_paper_001(lab_x):
    """(5) corrected: roll -J_T Omega q, pitch +J_T Omega p, with Omega = Omega_3 + Omega_4 - Omega_1 - Omega_2."""
    vehicle = plus(lab_x, x=(1, -1, 0, 0), y=(0, 0, -1, 1), direction=(1, 1, -1, -1))
    body_rate, speed = np.array([2.0, -3.0, 0.0]), np.array([100.0, 250, 460, 330])  # without r only pq couples
    relative_speed = speed[2] + speed[3] - speed[0] - speed[1]
    torque = np.array(DM(terms.coupling_torque(SX(body_rate), SX(speed), vehicle))).ravel()
    expected = vehicle.rotor_inertia * relative_speed * np.array([-body_rate[1], body_rate[0]])
    np.testing.assert_allclose(torque[:2], expected, rtol=1e-13)


def test_plus_frame_of_paper_004(lab_x):
    """(8), in its axes with y to the left and z up; the last row of (16) has the opposite sign in print."""
    vehicle = plus(lab_x, x=(1, 0, -1, 0), y=(0, 1, 0, -1), direction=(-1, 1, -1, 1))
    corrected = [[B, B, B, B], [0, -B * L, 0, B * L], [-B * L, 0, B * L, 0], [K, -K, K, -K]]
    np.testing.assert_allclose(np.diag([1, 1, -1, -1]) @ matrix(vehicle), corrected, rtol=1e-15)


def test_thrust_at_the_centre_of_mass_makes_no_torque(lab_x):
    """Moving the centre of mass to a rotor takes that rotor's lever away and lengthens the others'."""
    at_rotor_1 = dataclasses.replace(lab_x, centre_of_mass=np.array([lab_x.rotor_x[0], lab_x.rotor_y[0]]))
    torques = matrix(at_rotor_1)[1:3]
    a, b = lab_x.rotor_x[0], lab_x.thrust_coefficient[0]
    np.testing.assert_allclose(torques, [[0, -2 * a * b, -2 * a * b, 0], [0, 0, -2 * a * b, -2 * a * b]], atol=1e-20)
