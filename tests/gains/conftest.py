"""What the tests of gain design share: the packaged designs, and the request behind the reference figures."""

import json

import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains import hinf
from rotordx.gains.options import with_settings
from rotordx.gains.packaged import packaged_designs

#: Ren's vehicle with the assumptions of the reference figures: small angles, ideal v_z, L_f = 0.3, level flight.
REFERENCE = ("exact_kinematics=false", "filtered_velocity=false", "tilt=0", "lipschitz=0.3", "velocity_noise=0.02")


@pytest.fixture(scope="session")
def reference_options():
    return with_settings(hinf.Options(), REFERENCE)


@pytest.fixture(scope="session")
def reference_design(reference_options):
    """The H-infinity design that the reference figures are of."""
    return hinf.design(load_vehicle("ren_plus"), reference_options)


@pytest.fixture
def packaged():
    """Function that reads a packaged design as plain data, fresh each time."""
    return lambda vehicle, diagnoser: json.loads(
        (packaged_designs() / vehicle / f"{diagnoser}.json").read_text(encoding="utf-8")
    )
