"""Euler angles and quaternions describe the same attitude, and turn into each other without loss."""

import numpy as np
from casadi import SX, Function
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rotordx.fmus.model_terms import terms
from tests.equations import paper_model

_euler, _quaternion = SX.sym("euler", 3), SX.sym("quaternion", 4)
to_quaternion = Function("to_quaternion", [_euler], [terms.quaternion_from_euler(_euler)])
to_euler = Function("to_euler", [_quaternion], [terms.euler_from_quaternion(_quaternion)])
to_matrix = Function("to_matrix", [_quaternion], [terms.rotation_matrix_from_quaternion(_quaternion)])

angle = st.floats(-3.14, 3.14)
eulers = st.tuples(angle, st.floats(-1.5, 1.5), angle).map(np.array)
directions = hnp.arrays(float, 4, elements=st.floats(-1, 1))


@given(eulers)
def test_euler_angles_survive_the_round_trip(euler):
    np.testing.assert_allclose(np.array(to_euler(to_quaternion(euler))).ravel(), euler, atol=1e-12)


@given(directions)
def test_quaternions_survive_the_round_trip_up_to_their_sign(direction):
    norm = np.linalg.norm(direction)
    assume(norm > 1e-3)
    quaternion = direction / norm
    assume(abs(paper_model.rotation_by_quaternion(quaternion)[2, 0]) < 0.9999)
    back = np.array(to_quaternion(to_euler(quaternion))).ravel()
    np.testing.assert_allclose(back * np.sign(back @ quaternion), quaternion, atol=1e-11)


@given(eulers)
def test_both_give_the_same_rotation(euler):
    quaternion = np.array(to_quaternion(euler)).ravel()
    expected = paper_model.rotation(euler)
    np.testing.assert_allclose(paper_model.rotation_by_quaternion(quaternion), expected, atol=1e-14)
    np.testing.assert_allclose(np.array(to_matrix(quaternion)), expected, atol=1e-14)


@given(angle, angle, st.sampled_from([-1, 1]))
def test_euler_angles_stay_finite_and_right_where_they_are_singular(roll, yaw, sign):
    quaternion = np.array(to_quaternion([roll, sign * np.pi / 2, yaw])).ravel()
    for factor in (1, 1 + 1e-15, 1 - 1e-15):  # rounding may carry the sine of the pitch beyond 1
        euler = np.array(to_euler(factor * quaternion)).ravel()
        assert np.isfinite(euler).all()
        assert abs(euler[1] - sign * np.pi / 2) < 1e-6
