"""A diagnoser's symbolic step as a CasADi function and as C, for the FMU and for firmware alike."""

from __future__ import annotations

import tempfile
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca

from rotordx.fmus.diagnosers.c99 import strict_header, strict_source
from rotordx.fmus.diagnosers.interface import Clock, Command, Inputs, Measured
from rotordx.fmus.shell.ports import STEP_SIZE, Component, flatten, size, start_values, table, unflatten, with_starts
from rotordx.fmus.vehicles import load_design
from rotordx.fmus.vehicles.parameters import REFERENCE_VEHICLE, VehicleParameters

#: Instructions of one step; more do not fit the firmware's time slot, and compile for minutes.
INSTRUCTION_BUDGET = 8000


def diagnoser_component(name: str) -> Component:
    """FMU of a diagnoser: the common inputs, its vehicle and its parameters, its outputs.

    Parameters start at the design for the vehicle that the FMU starts with, if there is one.
    """
    module = _module(name)
    design = load_design(REFERENCE_VEHICLE, name) or {"parameters": {}}
    return Component(
        name=name,
        description=(module.__doc__ or "").splitlines()[0].rstrip("."),
        inputs=Inputs,
        outputs=module.Outputs,
        parameters=(VehicleParameters, with_starts(module.Parameters, design["parameters"])),
        constant_initial_outputs=True,
        tunable_parameters=True,
    )


def diagnoser_function(name: str) -> ca.Function:
    """`step(x, u, t, p) -> (x_next, y)` of a diagnoser; all are dense column vectors.

    x: state; u: inputs in port order; t: time of the sample [s]; p: step size [s], vehicle parameters, parameters;
    y: outputs in port order. This is the contiguous order of the FMU's values.

    Raises:
        ValueError: if the step returns other ports than its module declares, or exceeds the instruction budget.
    """
    module = _module(name)
    x = ca.SX.sym("x", size(module.State))
    u = ca.SX.sym("u", size(Inputs))
    t = ca.SX.sym("t")
    p = ca.SX.sym("p", STEP_SIZE.size + size(VehicleParameters) + size(module.Parameters))
    inputs = unflatten(Inputs, u)
    vehicle_end = STEP_SIZE.size + size(VehicleParameters)
    state, outputs = module.step(
        _part(Measured, inputs),
        _part(Command, inputs),
        unflatten(module.State, x),
        unflatten(module.Parameters, p[vehicle_end:]),
        unflatten(VehicleParameters, p[STEP_SIZE.size : vehicle_end]),
        Clock(time=t, dt=p[0]),
    )
    results = [_result(name, module.State, state), _result(name, module.Outputs, outputs)]
    names = ["x", "u", "t", "p"], ["x_next", "y"]
    function = ca.Function(f"{name}_step", [x, u, t, p], results, *names, {"cse": True})
    count = function.n_instructions()
    if count > INSTRUCTION_BUDGET:
        raise ValueError(f"diagnoser {name}: a step takes {count} instructions, the budget is {INSTRUCTION_BUDGET}")
    return function


def start_function(name: str) -> ca.Function:
    """`start() -> (x, y)` of a diagnoser: its initial state and what its outputs show before the first sample."""
    module = _module(name)
    results = [ca.SX(ca.DM(start_values(cls))) for cls in (module.State, module.Outputs)]
    return ca.Function(f"{name}_start", [], [ca.densify(r) for r in results], [], ["x", "y"])


def step_source(name: str) -> dict[str, str]:
    """C99 source and header of a diagnoser: file name -> contents; no heap, nothing but libm."""
    options: Any = {"casadi_int": "int"}
    generator = ca.CodeGenerator(f"{name}_step", options)
    functions = [start_function(name), diagnoser_function(name)]
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(f"{folder}/")
        printed = (Path(folder) / f"{name}_step.c").read_text()
    source, header = f"{name}_step.c", f"{name}_step.h"
    return {source: strict_source(source, printed), header: strict_header(*(f.name() for f in functions))}


def model(name: str) -> tuple[str, list[str]]:
    """C++ type of the FMU's model and the headers that declare it."""
    states = size(_module(name).State)
    includes = [f"{name}_ports.hpp", f"{name}_step.h", "fmus/diagnosers/diagnoser.hpp"]
    return f"Diagnoser<{states}, {name}_start, {name}_step>", includes


def _module(name: str) -> ModuleType:
    return import_module(f"rotordx.fmus.diagnosers.{name}.step")


def _part(cls: type[Any], inputs: Inputs) -> Any:
    """The ports of `cls` out of all inputs."""
    return cls(**{p.name: getattr(inputs, p.name) for p in table(cls)})


def _result(name: str, cls: type[Any], instance: Any) -> ca.SX:
    if not isinstance(instance, cls):
        raise ValueError(f"diagnoser {name}: step returns {type(instance).__name__} where {cls.__name__} is expected")
    vector = ca.densify(ca.SX(flatten(instance, ca.vertcat)))
    if vector.numel() != size(cls):
        raise ValueError(f"diagnoser {name}: {cls.__name__} has {vector.numel()} elements, not {size(cls)}")
    return vector
