"""A fault signature is what a total loss of a rotor's effectiveness adds to the rate dynamics; Jacobians are exact."""

import dataclasses

import numpy as np
import pytest
from casadi import DM, SX, Function

from rotordx.fmus.model_terms import terms

COLUMNS = ("zeta", "euler", "rotor_speed")


@pytest.fixture
def arguments(states):
    """zeta, euler and rotor_speed of 50 states."""
    zeta = np.column_stack([states["velocity"][:, 2], states["body_rate"]])
    return list(zip(zeta[:50], states["euler"][:50], states["rotor_speed"][:50], strict=True))


def rate_dynamics(arguments, vehicle):
    return np.array(DM(terms.rate_dynamics(*map(SX, arguments), vehicle))).ravel()


@pytest.mark.parametrize("rotor", [1, 2, 3, 4])
@pytest.mark.parametrize("loss", [0.05, 0.3, 1.0])
def test_loss_of_effectiveness_adds_its_share_of_the_signature(rotor, loss, arguments, vehicle):
    remaining = np.ones(4)
    remaining[rotor - 1] -= loss
    faulty_vehicle = dataclasses.replace(  # weaker in thrust and reaction torque, at the same speed
        vehicle,
        thrust_coefficient=vehicle.thrust_coefficient * remaining,
        torque_coefficient=vehicle.torque_coefficient * remaining,
    )
    for zeta, euler, rotor_speed in arguments:
        healthy = rate_dynamics((zeta, euler, rotor_speed), vehicle)
        faulty = rate_dynamics((zeta, euler, rotor_speed), faulty_vehicle)
        signature = np.array(DM(terms.fault_signatures(SX(euler), SX(rotor_speed), vehicle)))[:, rotor - 1]
        rounding = 1e-14 * max(1, np.abs(healthy).max(), np.abs(signature).max())
        np.testing.assert_allclose(faulty - healthy, loss * signature, rtol=1e-12, atol=10 * rounding)


def test_jacobians_equal_central_differences(arguments, vehicle):
    symbols = [SX.sym(name, len(column)) for name, column in zip(COLUMNS, arguments[0], strict=True)]
    derivatives = terms.jacobians(terms.rate_dynamics, symbols, vehicle)
    function = Function("f", symbols, [terms.rate_dynamics(*symbols, vehicle)])
    jacobians = Function("df", symbols, derivatives)
    for point in arguments:
        for index, jacobian in enumerate(jacobians(*point)):
            step = 1e-4 * np.maximum(1, np.abs(point[index]))
            for element, h in enumerate(step):
                ahead, behind = ([np.array(c) for c in point] for _ in range(2))
                ahead[index][element] += h
                behind[index][element] -= h
                difference = (function(*ahead) - function(*behind)) / (2 * h)
                np.testing.assert_allclose(jacobian[:, element], difference, rtol=1e-6, atol=1e-5)


def test_jacobians_are_taken_at_expressions_too(vehicle):
    zeta, euler, speed = SX.sym("zeta", 4), SX.sym("euler", 3), SX.sym("speed", 4)
    composed = terms.jacobians(terms.rate_dynamics, [2 * zeta, euler, speed], vehicle)[0]
    plain = terms.jacobians(terms.rate_dynamics, [zeta, euler, speed], vehicle)[0]
    point = (np.array([1.0, 2, 3, 4]), np.zeros(3), np.full(4, 100.0))
    at_composed = Function("f", [zeta, euler, speed], [composed])(*point)
    at_plain = Function("f", [zeta, euler, speed], [plain])(2 * point[0], *point[1:])
    np.testing.assert_array_equal(at_composed, at_plain)
