"""Systems of other tools: an archive of System Structure and Parameterization (SSP 1.0) as a scenario.

SSP says nothing of the order of computation: here elements are computed in the order in which they are declared, and a
connection from a later element to an earlier one carries the value from the end of the previous step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.fmus import component_names, diagnoser_ids, load_component, vehicle_names
from rotordx.fmus.esc.ports import FAULT_SLOTS
from rotordx.fmus.shell.model_description import token
from rotordx.fmus.shell.ports import started
from rotordx.orchestrator.parameters import FAULT_PARAMETERS, FAULT_SLOT_STARTS
from rotordx.orchestrator.scenario import PROFILES
from rotordx.orchestrator.ssp_archive import NAMESPACES, ROTORDX, SspArchive
from rotordx.orchestrator.ssp_connections import Connectors, Wire, connected
from rotordx.orchestrator.ssp_elements import Fmu, Subsystem, elements
from rotordx.orchestrator.ssp_parameters import Given
from rotordx.orchestrator.variables import Variable

_WHOLE = {"seed": "seed", "step_size": "step_size_s"}  # parameters that follow from fields of the scenario


def scenario_document(path: Path) -> dict[str, Any]:
    """An SSP archive as the document of a scenario, ready to be validated.

    Its parameters are all stated, so that none is taken from a vehicle; faults are read from those of the esc.

    Raises:
        UserError: it is no SSP 1.0 archive, or holds what cannot be flown here.
    """
    archive = SspArchive(path)
    root = archive.document("SystemStructure.ssd", "ssd:SystemStructureDescription")
    top = root.find("ssd:System", NAMESPACES)
    if top is None:
        raise archive.error("its SystemStructure.ssd has no System")
    found = list(elements(archive, top))
    systems = [element for element in found if isinstance(element, Subsystem)]
    fmus = [element for element in found if isinstance(element, Fmu)]
    order = {fmu.name: i for i, fmu in enumerate(fmus)}
    if len(order) < len(fmus):
        raise archive.error("the names of two elements differ in signs only, give one of them another name")
    connectors = Connectors(archive, systems, fmus, archive.units(root.find("ssd:Units", NAMESPACES)))
    components: dict[str, Any] = {}
    connections: list[dict[str, Any]] = []
    values: dict[str, dict[str, Any]] = {}
    for fmu in fmus:
        feeders = dict(connectors.feeders(fmu))
        given = _bound(fmu, systems) | {name: f for name, f in feeders.items() if isinstance(f, Given)}
        wires = {name: f for name, f in feeders.items() if isinstance(f, Wire)}
        _check(archive, fmu, feeders)
        own_connections, ports = connected(fmu, wires, order)
        connections += own_connections
        values[fmu.name] = _parameters(archive, fmu, given)
        components[fmu.name] = _installed(fmu) | {"parameters": values[fmu.name], "ports": ports}
    document: dict[str, Any] = {"system": "replay", "connections": connections} | _duration(archive, root)
    document |= _whole(archive, values, _step(archive, root)) | _vehicle(top)
    document["diagnosers"] = [fmu.name for fmu in fmus if "fault_detected" in fmu.variables]
    return document | {"components": components}


def _installed(fmu: Fmu) -> dict[str, Any]:
    """Settings of an FMU: the installed one in place of one that says it is ours, any other by its path.

    What an archive says of itself proves nothing: its libraries are never loaded into this process. An FMU of ours is
    known by its token, which stands for its version, ports and start values.
    """
    name = str(fmu.description.modelName)
    if name not in [*component_names(), *diagnoser_ids()]:
        return {"fmu": str(fmu.file)}
    starts: dict[str, float | None] = {}
    for variable in fmu.variables.values():
        starts |= zip(_scalars(variable), _starts(variable), strict=True)
    try:
        declared = started(load_component(name), {scalar: v for scalar, v in starts.items() if v is not None})
    except ValueError:
        return {"fmu": str(fmu.file)}
    known = {scalar for _, _, port in declared.variables() for scalar in port.element_names()}
    if known == starts.keys() - {"time"} and token(declared, version("rotordx")) == fmu.description.guid:
        return {"fmu": name, "fmi": int(fmu.description.fmiVersion[0])}
    return {"fmu": str(fmu.file)}


def _bound(fmu: Fmu, systems: Sequence[Subsystem]) -> dict[str, Given]:
    """Values that parameter bindings give to the variables of an FMU; those of the outer systems count most."""
    values = dict(fmu.values)
    around = [system for system in systems if system.path == fmu.path[: len(system.path)]]
    for system in sorted(around, key=lambda system: -len(system.path)):
        prefix = ".".join(fmu.path[len(system.path) :]) + "."
        values |= {name.removeprefix(prefix): given for name, given in system.values.items() if name.startswith(prefix)}
    return values


def _check(archive: SspArchive, fmu: Fmu, feeders: Mapping[str, Wire | Given]) -> None:
    """Refuse what is connected but cannot be."""
    for connector, feeder in feeders.items():
        variable = fmu.variable(connector)
        name = f"{'.'.join(fmu.path)}.{connector}"
        if variable is None:
            continue
        if isinstance(feeder, Wire) and variable.causality == "parameter":
            raise archive.error(f"the parameter {name} is connected to an output, give it a value instead")
        if isinstance(feeder, Given) and variable.causality == "input" and variable.is_number:
            raise archive.error(
                f"the input {name} is fed from outside the system with a constant, which is not supported: connect it "
                "to the output of an FMU"
            )


def _scalars(variable: Variable) -> list[str]:
    """Names of the elements of a variable."""
    return [variable.name] if variable.shape is None else [f"{variable.name}[{i + 1}]" for i in range(variable.size)]


def _starts(variable: Variable) -> Sequence[float | None]:
    """Start values of the elements of a variable, None where there are none."""
    if variable.start is None or len(variable.start) != variable.size:
        return [None] * variable.size
    return variable.start


def _parameters(archive: SspArchive, fmu: Fmu, given: Mapping[str, Given]) -> dict[str, Any]:
    """Every parameter of an FMU that has a value, and inputs that are given one: the given one, else its start."""
    parameters: dict[str, Any] = {}
    for name, variable in fmu.variables.items():
        settable = variable.causality == "input" and not variable.is_number
        if variable.causality != "parameter" and not (settable and any(s in given for s in _scalars(variable))):
            continue
        values = [
            given[scalar].value(archive, variable, scalar) if scalar in given else _named(variable, start)
            for scalar, start in zip(_scalars(variable), _starts(variable), strict=True)
        ]
        if None not in values:
            parameters[name] = values[0] if variable.shape is None else values
    return parameters


def _named(variable: Variable, start: float | None) -> Any:
    """A start value as a scenario has it: enumerations by name, true or false for booleans."""
    if variable.type == "Boolean" and start is not None:
        return bool(start)
    return next((name for name, value in variable.choices.items() if value == start), start)


def _whole(archive: SspArchive, values: Mapping[str, dict[str, Any]], step: float | None) -> dict[str, Any]:
    """Fields of the scenario as a whole, taken out of the parameters: faults, seed and step size.

    A component whose seed or step size is another than that of the first one keeps it.
    """
    fields: dict[str, Any] = {} if step is None else {"step_size_s": step}
    for parameters in values.values():
        slots = [parameters.get(name) for name in FAULT_PARAMETERS.values()]
        if all(isinstance(column, list) and len(column) == FAULT_SLOTS for column in slots):
            faults = {field: parameters.pop(name) for field, name in FAULT_PARAMETERS.items()}
            fields["faults"] = [_fault(archive, faults, i) for i, rotor in enumerate(faults["rotor"]) if rotor]
        for name, field in _WHOLE.items():
            value = parameters.get(name)
            if isinstance(value, int | float):
                fields.setdefault(field, _number_or_integer(value) if name == "seed" else value)
                if fields[field] == value:
                    del parameters[name]
    return fields


def _number_or_integer(value: float) -> float:
    """The number as an integer if it is one; if it should be, a scenario says so."""
    return int(value) if math.isfinite(value) and value == int(value) else value


def _fault(archive: SspArchive, columns: Mapping[str, list[float]], slot: int) -> dict[str, Any]:
    """A fault from its slot; a field that holds what an unused one holds was not given."""
    fault: dict[str, Any] = {}
    for field, name in FAULT_PARAMETERS.items():
        value = columns[field][slot]
        if field in ("rotor", "onset_s", "loss_of_effectiveness") or value != FAULT_SLOT_STARTS[name][slot]:
            fault[field] = value
    fault["rotor"] = _number_or_integer(fault["rotor"])
    if "profile" in fault:
        if fault["profile"] not in range(len(PROFILES)):
            raise archive.error(
                f"fault_profile[{slot + 1}] is {fault['profile']:g}, but must be 0 to {len(PROFILES) - 1}"
            )
        fault["profile"] = PROFILES[int(fault["profile"])]
    return fault


def _duration(archive: SspArchive, root: ET.Element) -> dict[str, float]:
    """How long to fly; without a stop time that is for the user to say."""
    stop = _number(archive, root.find("ssd:DefaultExperiment", NAMESPACES), "stopTime")
    return {} if stop is None or not math.isfinite(stop) else {"duration_s": stop}


def _step(archive: SspArchive, root: ET.Element) -> float | None:
    """The step size that an annotation states."""
    osp = _number(archive, root.find(".//osp:FixedStepAlgorithm", NAMESPACES), "baseStepSize")
    return osp or _number(archive, root.find(".//oms:FixedStepMaster", NAMESPACES), "stepSize")


def _number(archive: SspArchive, element: ET.Element | None, attribute: str) -> float | None:
    text = element.get(attribute) if element is not None else None
    try:
        return float(text) if text is not None else None
    except ValueError:
        raise archive.error(f"{attribute} is {text!r}, but must be a number") from None


def _vehicle(top: ET.Element) -> dict[str, str]:
    for annotation in top.findall(f"ssd:Annotations/ssc:Annotation[@type='{ROTORDX}']/vehicle", NAMESPACES):
        if annotation.get("name") in vehicle_names():
            return {"vehicle": annotation.get("name", "")}
    return {}
