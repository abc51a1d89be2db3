"""The allocation matrix of any planar rotor geometry, on numbers and symbols alike."""

from __future__ import annotations

from typing import Any


def allocation_rows(vehicle: Any) -> list[list[Any]]:
    """Rows of M: [U; tau_x; tau_y; tau_z] = M [Omega_1^2; ...; Omega_4^2], thrust U along -z of the body (FRD).

    Rotor i at (x_i, y_i) pushes b_i Omega_i^2 along -z, so its torque about the centre of mass (c_x, c_y) is
    b_i Omega_i^2 (-(y_i - c_y), x_i - c_x) and its reaction torque is direction_i k_i Omega_i^2. Paper 000 (10), (11)
    is the X geometry of this. The sign of the reaction torque is part of M: speeds enter squared, without their sign.

    Args:
        vehicle: `VehicleParameters` of numbers or symbols.
    """
    thrust, centre, rotors = vehicle.thrust_coefficient, vehicle.centre_of_mass, range(4)
    return [
        [thrust[i] for i in rotors],
        [-thrust[i] * (vehicle.rotor_y[i] - centre[1]) for i in rotors],
        [thrust[i] * (vehicle.rotor_x[i] - centre[0]) for i in rotors],
        [vehicle.rotor_direction[i] * vehicle.torque_coefficient[i] for i in rotors],
    ]
