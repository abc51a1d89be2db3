"""The built FMU computes what the Python function computes, over 30,000 steps."""

import shutil

import fmpy
import numpy as np
import pytest
from casadi import DM
from fmpy.fmi3 import FMU3Slave

from rotordx.fmus import fmu_path, load_component
from rotordx.fmus.diagnosers import codegen
from rotordx.fmus.diagnosers.fdie.step import Outputs, State
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.shell.ports import size, start_values, table
from tests.fdie.noisy_flights import FLIGHTS, NOISY, STEPS, deviation, flown
from tests.fdie.world import DT, by_name, constants


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    folder = fmpy.extract(fmu_path("fdie"), tmp_path_factory.mktemp("fdie"))
    token = fmpy.read_model_description(folder).guid
    instance = FMU3Slave(guid=token, unzipDirectory=folder, modelIdentifier="fdie", instanceName="fdie")
    instance.instantiate()
    yield instance
    instance.freeInstance()
    shutil.rmtree(folder)


def by_fmu(fmu, u, p):
    """Outputs (steps, size) for inputs (steps, size) and the constants p, which lie in the order of the ports."""
    variables = list(load_component("fdie").variables())
    references = {port.name: reference for reference, _, port in variables}
    parameters = [port for _, causality, port in variables if causality == "parameter"]
    values = np.split(p, np.cumsum([port.size for port in parameters])[:-1])
    fmu.enterInitializationMode()
    for port, value in zip(parameters, values, strict=True):
        if port.choices:
            fmu.setInt64([references[port.name]], [int(value[0])])
        else:
            fmu.setFloat64([references[port.name]], value.tolist())
    fmu.exitInitializationMode()
    inputs = [references[port.name] for port in table(Inputs)]
    outputs = [references[port.name] for port in table(Outputs)]
    rows = []
    for k, row in enumerate(u):
        fmu.setFloat64(inputs, row.tolist())
        fmu.doStep(k * DT, DT)
        rows.append(fmu.getFloat64(outputs, size(Outputs)))
    fmu.reset()
    return np.array(rows)


def test_fmu_equals_the_python_function(fmu):
    """A sample is taken at the end of a step: the first one, at DT, ends the first doStep."""
    command, euler, zeta = flown(STEPS)
    function = codegen.diagnoser_function("fdie").mapaccum(STEPS)
    start = np.array(start_values(State))
    time = DM(np.arange(1, STEPS + 1) * DT).T
    for i, (_, _, changes) in enumerate(FLIGHTS):
        p = constants(**NOISY | changes)
        u = np.hstack([command[:, i], euler[:, i], zeta[:, i, 1:], zeta[:, i, :1]])
        _, y = function(start, u.T, time, np.tile(p[:, None], STEPS))
        actual = by_name(by_fmu(fmu, u, p), Outputs)
        assert deviation(actual, by_name(np.array(y).T, Outputs)) < 1e-12
