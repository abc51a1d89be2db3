"""The native stepper does what a master written with FMPy's own methods does, bit for bit."""

from __future__ import annotations

import numpy as np

from rotordx.orchestrator.flight import fly
from tests.benchmarks.fmpy_master import FmpyMaster


def test_five_hundred_steps_agree(system, short):
    scenario = short()
    expected = fly(scenario, system)
    system.initialise(scenario)
    master = FmpyMaster(system)
    for step in range(1, scenario.steps + 1):
        master.advance(step - 1, 1)
        for key, values in expected.signals.items():
            assert np.array_equal(np.ravel(values[step]), master.signal(key), equal_nan=True), (key, step)
