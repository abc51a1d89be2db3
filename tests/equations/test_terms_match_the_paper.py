"""The model terms are the paper's dynamics: at random large states they equal an independent derivation to 1e-9."""

import dataclasses

import numpy as np
import pytest
from casadi import SX, Function, vec, vertcat
from scipy.integrate import solve_ivp

from rotordx.fmus.model_terms import terms
from tests.equations import paper_model

TOLERANCE = 1e-9


def of_terms(term, columns, *context):
    """term(*columns, *context) at many states; one row a state, in and out."""
    arguments = [SX.sym(f"argument_{i}", column.shape[1]) for i, column in enumerate(columns)]
    function = Function("term", arguments, [term(*arguments, *context)])
    return np.array(function.map(len(columns[0]))(*(column.T for column in columns))).T


def of_paper(function, states, *names):
    """function(...) of each state, given the named parts of it."""
    return np.array([function(*parts) for parts in zip(*(states[name] for name in names), strict=True)])


def deviation(actual, expected):
    """Largest deviation, relative to the largest expected value of each component (at least to 1)."""
    return np.max(np.abs(actual - expected) / np.maximum(1, np.abs(expected).max(axis=0)))


def rigid_body_states(states):
    quaternion = of_terms(terms.quaternion_from_euler, [states["euler"]])
    return np.column_stack([states["position"], states["velocity"], quaternion, states["body_rate"]])


def rate_dynamics_deviation(states, vehicle):
    zeta = np.column_stack([states["velocity"][:, 2], states["body_rate"]])
    actual = of_terms(terms.rate_dynamics, [zeta, states["euler"], states["rotor_speed"]], vehicle)

    def expected(velocity, euler, body_rate, rotor_speed):
        vertical = paper_model.acceleration(velocity, euler, rotor_speed, vehicle)[2]
        return [vertical, *paper_model.angular_acceleration(euler, body_rate, rotor_speed, vehicle)]

    return deviation(actual, of_paper(expected, states, "velocity", "euler", "body_rate", "rotor_speed"))


def rigid_body_deviation(states, vehicle):
    state = rigid_body_states(states)
    derivative = of_terms(terms.rigid_body_derivative, [state, states["rotor_speed"], states["disturbance"]], vehicle)
    turning = [  # complex step along the quaternion's rate
        paper_model.rotation_by_quaternion(q + 1j * paper_model.COMPLEX_STEP * rate).imag.ravel()
        for q, rate in zip(state[:, 6:10], derivative[:, 6:10], strict=True)
    ]
    actual = np.column_stack([derivative[:, :6], np.array(turning) / paper_model.COMPLEX_STEP, derivative[:, 10:]])

    def expected(velocity, euler, body_rate, rotor_speed, disturbance):
        return [
            *velocity,
            *(paper_model.acceleration(velocity, euler, rotor_speed, vehicle) + disturbance[:3]),
            *paper_model.rotation_rate(euler, body_rate).ravel(),
            *(paper_model.angular_acceleration(euler, body_rate, rotor_speed, vehicle) + disturbance[3:]),
        ]

    return deviation(actual, of_paper(expected, states, "velocity", "euler", "body_rate", "rotor_speed", "disturbance"))


def test_rate_dynamics(states, vehicle):
    assert rate_dynamics_deviation(states, vehicle) < TOLERANCE


def test_rigid_body_derivative(states, vehicle):
    assert rigid_body_deviation(states, vehicle) < TOLERANCE


def test_specific_force_is_the_acceleration_without_gravity_in_body_axes(states, vehicle):
    arguments = [rigid_body_states(states), states["rotor_speed"], states["disturbance"]]

    def expected(velocity, euler, rotor_speed, disturbance):
        acceleration = paper_model.acceleration(velocity, euler, rotor_speed, vehicle) + disturbance[:3]
        return paper_model.rotation(euler).T @ (acceleration - [0, 0, vehicle.gravity])

    actual = of_terms(terms.specific_force, arguments, vehicle)
    assert deviation(actual, of_paper(expected, states, "velocity", "euler", "rotor_speed", "disturbance")) < TOLERANCE


@pytest.mark.parametrize("vehicle", ["lab_x"], indirect=True)
def test_attitude_kinematics(states):
    rates = of_terms(terms.euler_rate, [states["euler"], states["body_rate"]])
    assert deviation(rates, of_paper(paper_model.euler_rate, states, "euler", "body_rate")) < TOLERANCE
    matrices = of_terms(lambda euler: vec(terms.rotation_matrix(euler).T), [states["euler"]])
    assert deviation(matrices, of_paper(lambda e: paper_model.rotation(e).ravel(), states, "euler")) < TOLERANCE


@pytest.mark.parametrize("vehicle", ["lab_x"], indirect=True)
def test_motor_lag_solves_its_differential_equation(vehicle):
    speed, target = np.array([100.0, 300, 500, 900]), np.array([500.0, 500, 120, 950])
    tau, dt = vehicle.motor_time_constant, 0.01

    def lag(columns):
        return terms.motor_lag(columns[:4], columns[4:8], columns[8], vehicle)

    actual = of_terms(lag, [np.array([[*speed, *target, dt]])])[0]
    solution = solve_ivp(lambda t, x: (target - x) / tau, (0, dt), speed, method="DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(actual, solution.y[:, -1], rtol=1e-10)


# Mutants: mistakes that flights hardly reveal; the comparisons above must see each of them.


def phi_with_signs_of_p_and_q_flipped(body_rate, rotor_speed, vehicle, original=terms.coupling_torque):
    return vertcat(-1, -1, 1) * original(body_rate, rotor_speed, vehicle)


def phi_with_rows_of_p_and_q_exchanged(body_rate, rotor_speed, vehicle, original=terms.coupling_torque):
    return original(body_rate, rotor_speed, vehicle)[[1, 0, 2]]


def gyroscopic_torque_with_wrong_sign(body_rate, rotor_speed, vehicle, original=terms.coupling_torque):
    return original(body_rate, rotor_speed, dataclasses.replace(vehicle, rotor_inertia=-vehicle.rotor_inertia))


def thrust_without_tilt(euler, vehicle, original=terms.input_gain):
    return original(SX.zeros(3), vehicle)


def yaw_torque_with_wrong_sign(vehicle, original=terms.allocation):
    return original(dataclasses.replace(vehicle, rotor_direction=-vehicle.rotor_direction))


def left_and_right_exchanged(vehicle, original=terms.allocation):
    return original(dataclasses.replace(vehicle, rotor_y=-vehicle.rotor_y))


def centre_of_mass_with_wrong_sign(vehicle, original=terms.allocation):
    return original(dataclasses.replace(vehicle, centre_of_mass=-vehicle.centre_of_mass))


def attitude_turning_backwards(quaternion, body_rate, original=terms.quaternion_rate):
    return original(quaternion, -body_rate)


def rotation_inverted(quaternion, original=terms.rotation_matrix_from_quaternion):
    return original(quaternion).T


@pytest.mark.parametrize("vehicle", ["asymmetric"], indirect=True)
@pytest.mark.parametrize(
    ("term", "mutant"),
    [
        ("coupling_torque", phi_with_signs_of_p_and_q_flipped),
        ("coupling_torque", phi_with_rows_of_p_and_q_exchanged),
        ("coupling_torque", gyroscopic_torque_with_wrong_sign),
        ("input_gain", thrust_without_tilt),
        ("allocation", yaw_torque_with_wrong_sign),
        ("allocation", left_and_right_exchanged),
        ("allocation", centre_of_mass_with_wrong_sign),
        ("quaternion_rate", attitude_turning_backwards),
        ("rotation_matrix_from_quaternion", rotation_inverted),
    ],
)
def test_a_mistake_is_seen(term, mutant, states, vehicle, monkeypatch):
    monkeypatch.setattr(terms, term, mutant)
    some = {name: column[:50] for name, column in states.items()}
    assert max(rate_dynamics_deviation(some, vehicle), rigid_body_deviation(some, vehicle)) > 1e-3
