"""What the tests of `fdie` share."""

import pytest

from rotordx.fmus.diagnosers import codegen
from tests.fdie import continuous_motion
from tests.fdie.world import Compiled


@pytest.fixture(scope="session")
def diagnoser(tmp_path_factory):
    """The function that the FMU is generated from, as C."""
    return Compiled(codegen.diagnoser_function("fdie"), tmp_path_factory.mktemp("fdie"))


@pytest.fixture(scope="session")
def continuous_flight():
    return continuous_motion.continuous_flight()
