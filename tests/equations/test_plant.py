"""The plant FMU integrates the equations of motion: 10 s of tumbling as a solver of high order has it."""

import shutil
from itertools import pairwise

import fmpy
import numpy as np
import pytest
from casadi import SX, Function
from fmpy.fmi3 import FMU3Slave
from scipy.integrate import solve_ivp

from rotordx.fmus import fmu_path
from rotordx.fmus.model_terms import terms
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters

STEP, DURATION, TOLERANCE = 0.002, 10.0, 1e-6
INITIAL = {
    "initial_position": [1.0, -2.0, -3.0],
    "initial_velocity": [2.0, 1.0, -1.0],
    "initial_euler": [0.5, -0.4, 2.0],
    "initial_body_rate": [8.0, -6.0, 4.0],
}

#: Rotor speeds (rad/s) at the knots of piecewise linear courses; knots are multiples of the step.
COURSES = {
    "constant": {0.0: (555, 552, 556, 551), DURATION: (555, 552, 556, 551)},
    "linearly interpolated": {
        0.0: (555, 552, 556, 551),
        2.5: (755, 747, 761, 751),
        5.0: (405, 397, 406, 406),
        7.5: (855, 852, 856, 861),
        DURATION: (555, 552, 556, 551),
    },
}


@pytest.fixture
def plant(tmp_path):
    """The plant of lab_x with the initial state above, ready for initialisation; its variables by name."""
    description = fmpy.read_model_description(fmu_path("plant"))
    folder = fmpy.extract(fmu_path("plant"), tmp_path / "plant")
    slave = FMU3Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="plant",
    )
    slave.instantiate()
    yield slave, {v.name: v.valueReference for v in description.modelVariables}
    slave.freeInstance()
    shutil.rmtree(folder)


def speed_at(course, time):
    return np.array([np.interp(time, list(course), column) for column in np.transpose(list(course.values()))])


def flown(plant, course):
    """State (13) that the FMU ends in."""
    slave, reference = plant
    for name, value in INITIAL.items():
        slave.setFloat64([reference[name]], value)
    slave.enterInitializationMode()
    slave.setFloat64([reference["rotor_speed"]], speed_at(course, 0.0))
    slave.exitInitializationMode()
    for k in range(round(DURATION / STEP)):
        slave.setFloat64([reference["rotor_speed"]], speed_at(course, (k + 1) * STEP))
        slave.doStep(k * STEP, STEP)
    outputs = ("position", 3), ("velocity", 3), ("quaternion", 4), ("body_rate", 3)
    return np.concatenate([slave.getFloat64([reference[name]], nValues=count) for name, count in outputs])


def solved(course):
    """The same by DOP853 from knot to knot."""
    symbols = [SX.sym("state", 13), SX.sym("rotor_speed", 4), SX.sym("disturbance", 6)]
    vehicle = load_vehicle("lab_x").fill(VehicleParameters)
    derivative = Function("derivative", symbols, [terms.rigid_body_derivative(*symbols, vehicle)])
    euler = SX.sym("euler", 3)
    quaternion = Function("quaternion", [euler], [terms.quaternion_from_euler(euler)])(INITIAL["initial_euler"])
    state = np.concatenate(
        [
            INITIAL["initial_position"],
            INITIAL["initial_velocity"],
            np.array(quaternion).ravel(),
            INITIAL["initial_body_rate"],
        ]
    )
    for start, end in pairwise(course):
        solution = solve_ivp(
            lambda t, x: np.array(derivative(x, speed_at(course, t), np.zeros(6))).ravel(),
            (start, end),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        )
        state = solution.y[:, -1]
    return state


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES.keys())
def test_ten_seconds_of_tumbling(plant, course):
    actual, expected = flown(plant, course), solved(course)
    for part in (slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)):
        deviation = np.linalg.norm(actual[part] - expected[part]) / np.linalg.norm(expected[part])
        assert deviation < TOLERANCE
