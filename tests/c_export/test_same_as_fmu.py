"""The exported C is what the FMU runs: bit for bit in double precision, the same verdict in single precision.

gcc compiles it here with every warning an error.
"""

import functools

import numpy as np
import pytest

from rotordx.fmus.diagnosers.codegen import step_source
from rotordx.fmus.vehicles import load_design
from tests.c_export.toolchain import export, flown, host_program, loss_difference, played, same_verdict

flight = functools.cache(flown)


def test_it_contains_the_source_of_the_fmu(exported):
    assert step_source(exported.diagnoser)[f"{exported.diagnoser}_step.c"] in exported.source.read_text()


def test_double_precision_is_the_fmu_bit_for_bit(exported, tmp_path):
    inputs, answers = flight(exported.diagnoser)
    outputs = played([host_program(exported, "double", tmp_path)], inputs, tmp_path)
    assert len(outputs) == 30000
    assert np.array_equal(outputs, answers, equal_nan=True)
    assert answers[-1, 0] == (load_design("lab_x", exported.diagnoser) is not None)  # a fault is found by all but null


def test_single_precision_comes_to_the_same_verdict(exported, tmp_path):
    inputs, answers = flight(exported.diagnoser)
    outputs = played([host_program(exported, "single", tmp_path)], inputs, tmp_path)
    assert same_verdict(outputs, answers, exported.subject.step_size)
    assert loss_difference(outputs, answers) < 1e-3


@pytest.mark.xdist_group("c_export_fdie")
def test_parameters_of_another_vehicle_reach_the_c(tmp_path):
    inputs, answers = flown("fdie", vehicle="crazyflie", duration_s=12.0, faults=[], seed=3)
    small = export("fdie", tmp_path / "crazyflie", "crazyflie")
    outputs = played([host_program(small, "double", tmp_path)], inputs, tmp_path)
    assert np.array_equal(outputs, answers, equal_nan=True)
