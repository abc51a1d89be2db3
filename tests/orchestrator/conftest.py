"""Systems that the tests of this folder share: loading one takes longer than a short flight."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System


@pytest.fixture(scope="session")
def system() -> Iterator[System]:
    """The system of `short`; flights may change parameters only."""
    with System(load_scenario("avram_circle")) as loaded:
        yield loaded


@pytest.fixture
def short() -> Callable[..., Scenario]:
    """The default scenario cut to one second with a fault at 0.5 s; takes changes of fields."""

    def change(**changes: Any) -> Scenario:
        fault = {"rotor": 1, "onset_s": 0.5, "loss_of_effectiveness": 0.2}
        return load_scenario("avram_circle", **({"duration_s": 1.0, "faults": [fault]} | changes))

    return change
