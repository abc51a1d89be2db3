"""What the tests of the equations share: vehicles and random large states."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.fmus.vehicles.spread import perturbed

STATES = 1000


@pytest.fixture(params=["lab_x", "crazyflie", "asymmetric"])
def vehicle(request) -> VehicleParameters:
    """Parameters as numbers; in the asymmetric vehicle nothing cancels, its rotors differ and its balance is off."""
    if request.param == "asymmetric":
        return perturbed(load_vehicle("lab_x"), np.random.default_rng(7), scale=5).fill(VehicleParameters)
    return load_vehicle(request.param).fill(VehicleParameters)


@pytest.fixture
def states(vehicle):
    """STATES random large states, each row of an array one state."""
    rng = np.random.default_rng(0)
    return {
        "position": rng.uniform(-100, 100, (STATES, 3)),
        "velocity": rng.uniform(-15, 15, (STATES, 3)),
        "euler": rng.uniform([-np.pi, -1.2, -np.pi], [np.pi, 1.2, np.pi], (STATES, 3)),
        "body_rate": rng.uniform(-10, 10, (STATES, 3)),
        "rotor_speed": rng.uniform(0, vehicle.rotor_speed_max, (STATES, 4)),
        "disturbance": rng.uniform(-5, 5, (STATES, 6)),
    }
