"""Components through their built FMUs: values in and out by port name, one array per port."""

from __future__ import annotations

import functools
import shutil

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from numpy.typing import NDArray

from rotordx.fmus import fmu_path, load_component
from rotordx.fmus.vehicles import Vehicle, load_vehicle

STEP = 0.002

packaged = functools.cache(load_vehicle)


class Component:
    """One instance of a component; its log messages are in `messages`.

    Of the vehicle's parameters it takes those that it declares; `parameters` override them.
    """

    def __init__(self, name: str, folder: str, token: str, vehicle: Vehicle, **parameters):
        variables = list(load_component(name).variables())
        self.declared = {p.name: (reference, p) for reference, _, p in variables}
        self.outputs = {p.name: reference for reference, causality, p in variables if causality == "output"}
        self.messages: list[str] = []
        self.fmu = FMU3Slave(guid=token, unzipDirectory=folder, modelIdentifier=name, instanceName=name)
        self.fmu.instantiate(logMessage=lambda environment, status, category, text: self.messages.append(text.decode()))
        self.step_size = parameters.get("step_size", STEP)
        known = {key: value for key, value in vehicle.parameters.items() if key in self.declared}
        self.set(**{**known, **parameters})

    def set(self, **values) -> None:
        references, elements = [], []
        for name, value in values.items():
            reference, port = self.declared[name]
            if port.choices:
                self.fmu.setInt64([reference], [port.choices.index(value)])
            else:
                references.append(reference)
                elements.extend(np.ravel(value).tolist())
        if references:
            self.fmu.setFloat64(references, elements)

    def initialise(self, start_time: float = 0.0, **inputs) -> Component:
        self.time, self.steps = start_time, 0
        self.fmu.enterInitializationMode(startTime=start_time)
        self.set(**inputs)
        self.fmu.exitInitializationMode()
        return self

    def step(self, **inputs) -> None:
        self.set(**inputs)
        self.fmu.doStep(self.time + self.steps * self.step_size, self.step_size)
        self.steps += 1

    def __getitem__(self, name: str) -> NDArray:
        reference, port = self.declared[name]
        return np.array(self.fmu.getFloat64([reference], port.size))

    def read(self) -> dict[str, NDArray]:
        """All outputs."""
        sizes = [self.declared[name][1].size for name in self.outputs]
        values = np.array(self.fmu.getFloat64(list(self.outputs.values()), sum(sizes)))
        return dict(zip(self.outputs, np.split(values, np.cumsum(sizes)[:-1]), strict=True))

    def run(self, steps: int, **inputs) -> dict[str, NDArray]:
        """Outputs (steps + 1, size) from the present instant on; inputs (steps, size) act in one step each."""
        history = [self.read()]
        for k in range(steps):
            self.step(**{name: values[k] for name, values in inputs.items()})
            history.append(self.read())
        return {name: np.array([outputs[name] for outputs in history]) for name in self.outputs}


@pytest.fixture(scope="session")
def fmus(tmp_path_factory):
    """Folder and token of an extracted FMU by its name."""
    root = tmp_path_factory.mktemp("components")

    @functools.cache
    def extracted(name: str) -> tuple[str, str]:
        folder = fmpy.extract(fmu_path(name), root / name)
        return folder, fmpy.read_model_description(folder).guid

    yield extracted
    shutil.rmtree(root)


@pytest.fixture
def component(fmus):
    """Makes components, of lab_x unless told otherwise: component("esc", fault_rotor=[1, 0, ...])."""
    made = []

    def make(name: str, vehicle: str | Vehicle = "lab_x", **parameters) -> Component:
        loaded = vehicle if isinstance(vehicle, Vehicle) else packaged(vehicle)
        made.append(Component(name, *fmus(name), loaded, **parameters))
        return made[-1]

    yield make
    for instance in made:
        instance.fmu.freeInstance()
