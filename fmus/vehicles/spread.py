"""Vehicles as they are built: parameters that deviate from the nominal ones within tolerances, for Monte Carlo."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.fmus.vehicles.vehicle import Vehicle

if TYPE_CHECKING:
    import numpy as np

#: Largest relative deviation of all elements of a parameter together, and of each one besides.
RELATIVE = {
    "mass": (0.02, 0.0),
    "inertia": (0.0, 0.04),
    "thrust_coefficient": (0.015, 0.01),
    "torque_coefficient": (0.04, 0.0),
    "drag_coefficient": (0.15, 0.0),
    "motor_time_constant": (0.15, 0.0),
}

#: Largest deviation of each coordinate of the centre of mass (m).
CENTRE_OF_MASS = 0.001

#: Largest battery sag: 1 % of the thrust a minute (1/s).
BATTERY_SAG_RATE = 0.01 / 60


def perturbed(vehicle: Vehicle, rng: np.random.Generator, scale: float = 1.0) -> Vehicle:
    """One specimen of a vehicle; every deviation is uniformly distributed within its tolerance.

    Args:
        vehicle: the nominal vehicle.
        rng: source of the deviations; the same state of it gives the same specimen.
        scale: factor on all tolerances.

    Returns:
        the vehicle with other parameters and a battery that sags.
    """
    parameters = dict(vehicle.parameters)
    for name, (common, individual) in RELATIVE.items():
        value = parameters[name]
        together = 1 + scale * common * rng.uniform(-1, 1)
        if isinstance(value, tuple):
            parameters[name] = tuple(v * together * (1 + scale * individual * rng.uniform(-1, 1)) for v in value)
        else:
            parameters[name] = value * together
    centre = vehicle.fill(VehicleParameters).centre_of_mass
    parameters["centre_of_mass"] = tuple(float(c + scale * CENTRE_OF_MASS * rng.uniform(-1, 1)) for c in centre)
    parameters["battery_sag_rate"] = scale * BATTERY_SAG_RATE * rng.uniform()
    return dataclasses.replace(vehicle, parameters=parameters)
