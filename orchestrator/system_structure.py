"""Systems of other tools: an archive of System Structure and Parameterization (SSP 1.0) as a scenario.

SSP says nothing of the order of computation: here elements are computed in the order in which they are declared, and a
connection from a later element to an earlier one carries the value from the end of the previous step.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.fmus import component_names, diagnoser_ids, fmu_path, vehicle_names
from rotordx.orchestrator.archive import extract, open_archive
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.parameters import FAULT_PARAMETERS, FAULT_SLOT_STARTS
from rotordx.orchestrator.scenario import PROFILES
from rotordx.orchestrator.variables import Variable, read_variables

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}
OSP = "com.opensimulationplatform"  #: annotation that holds the step size, which SSP has no element for
ROTORDX = "org.rotordx"  #: annotation that holds the vehicle's name

_WHOLE = {"seed": "seed", "step_size": "step_size_s"}  # parameters that follow from fields of the scenario
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


def scenario_document(path: Path) -> dict[str, Any]:
    """An SSP archive as the document of a scenario, ready to be validated.

    Its parameters are all stated, so that none is taken from a vehicle; faults are read from those of the esc.

    Raises:
        UserError: it is no SSP 1.0 archive, or holds what cannot be flown here.
    """
    folder = extract(path, "an SSP archive")
    try:
        root = ET.parse(folder / "SystemStructure.ssd").getroot()
    except (OSError, ET.ParseError) as error:
        raise UserError(f"{path} is not an SSP archive: its SystemStructure.ssd cannot be read ({error})") from error
    top = root.find("ssd:System", NAMESPACES)
    if top is None:
        raise UserError(f"{path}: its SystemStructure.ssd has no System")
    elements = top.findall("ssd:Elements/*", NAMESPACES)
    for element in elements:
        if element.tag != _tag("Component") or element.get("type", _FMU) != _FMU:
            raise UserError(
                f"{path}: the element {element.get('name')} is no FMU, systems within systems are not supported"
            )
    names = [element.get("name", "") for element in elements]
    sources = {name: _source(path, folder, element) for name, element in zip(names, elements, strict=True)}
    known = {name: _variables(name, fmu) for name, fmu in sources.items()}
    values = {
        name: _parameters(
            path, known[name], _values(path, folder, element, "") | _values(path, folder, top, f"{name}.")
        )
        for name, element in zip(names, elements, strict=True)
    }
    connections, split = _connections(path, top, known)
    document: dict[str, Any] = {"system": "replay", "duration_s": _stop_time(path, root), "connections": connections}
    document |= _whole(values) | _step(root) | _vehicle(top)
    document["diagnosers"] = [name for name in names if "fault_detected" in known[name]]
    document["components"] = {
        name: _fmu(sources[name]) | {"parameters": values[name], "ports": split.get(name, {})} for name in names
    }
    return document


_FMU = "application/x-fmu-sharedlibrary"


def _tag(name: str, prefix: str = "ssd") -> str:
    return f"{{{NAMESPACES[prefix]}}}{name}"


def _source(path: Path, folder: Path, element: ET.Element) -> Path:
    """The FMU of an element."""
    source = element.get("source", "")
    fmu = (folder / source).resolve()
    if not fmu.is_relative_to(folder.resolve()) or not fmu.is_file():
        raise UserError(f"{path}: the source {source!r} of {element.get('name')} is not in the archive")
    return fmu


def _variables(name: str, fmu: Path) -> dict[str, Variable]:
    return read_variables(open_archive(fmu).description, {}, name)


def _fmu(path: Path) -> dict[str, Any]:
    """Settings of an FMU: one of ours under its name, so that it need not be isolated, any other by its path."""
    content = path.read_bytes()
    for name in [*component_names(), *diagnoser_ids()]:
        for fmi in (2, 3):
            if fmu_path(name, fmi).read_bytes() == content:
                return {"fmu": name, "fmi": fmi}
    return {"fmu": str(path)}


def _values(path: Path, folder: Path, element: ET.Element, prefix: str) -> dict[str, str]:
    """Values that the parameter bindings of an element or a system state, of names with a prefix, which is left out."""
    values: dict[str, str] = {}
    for binding in element.findall("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
        if binding.find("ssd:ParameterMapping", NAMESPACES) is not None:
            raise UserError(f"{path}: parameter mappings are not supported, bind the parameters under their own names")
        parameters = binding.find("ssd:ParameterValues/ssv:ParameterSet", NAMESPACES)
        if parameters is None:
            parameters = _parameter_set(path, folder, binding.get("source", ""))
        for parameter in parameters.findall("ssv:Parameters/ssv:Parameter", NAMESPACES):
            name = binding.get("prefix", "") + parameter.get("name", "")
            if name.startswith(prefix) and len(parameter):
                values[name.removeprefix(prefix)] = parameter[0].get("value", "")
    return values


def _parameter_set(path: Path, folder: Path, source: str) -> ET.Element:
    file = (folder / source).resolve()
    try:
        if not file.is_relative_to(folder.resolve()):
            raise OSError("it leads out of the archive")
        return ET.parse(file).getroot()
    except (OSError, ET.ParseError) as error:
        raise UserError(f"{path}: the parameter set {source!r} cannot be read: {error}") from error


def _parameters(path: Path, variables: Mapping[str, Variable], given: Mapping[str, str]) -> dict[str, Any]:
    """Every parameter of an FMU that has a value: the given one, else its start value."""
    parameters: dict[str, Any] = {}
    for name, variable in variables.items():
        if variable.causality != "parameter":
            continue
        starts = variable.start or (None,) * variable.size
        scalars = [name] if variable.shape is None else [f"{name}[{i + 1}]" for i in range(variable.size)]
        elements = [
            start if scalar not in given else _value(path, variable, scalar, given[scalar])
            for scalar, start in zip(scalars, starts, strict=True)
        ]
        if None not in elements:
            parameters[name] = elements[0] if variable.shape is None else elements
    return parameters


def _value(path: Path, variable: Variable, name: str, text: str) -> Any:
    if variable.type == "String" or text in variable.choices:
        return text
    try:
        return {"true": True, "false": False}[text] if variable.type == "Boolean" else float(text)
    except (KeyError, ValueError):
        raise UserError(f"{path}: the parameter {name} is {text!r}, but must be a {variable.type}") from None


def _connections(
    path: Path, top: ET.Element, known: Mapping[str, Mapping[str, Variable]]
) -> tuple[list[dict[str, Any]], dict[str, dict[str, str]]]:
    """Connections between ports, and by component the arrays that have to be split: port -> variable.

    Arrays are connected element by element in SSP; those whose elements come in order from one array are joined.
    """
    by_port: dict[tuple[str, str], dict[int, tuple[str, str]]] = defaultdict(dict)
    for connection in top.findall("ssd:Connections/ssd:Connection", NAMESPACES):
        ends = [connection.get(key, "") for key in ("startElement", "startConnector", "endElement", "endConnector")]
        if not ends[0] or not ends[2]:
            raise UserError(
                f"{path}: the system's own connector {ends[1] or ends[3]} is connected, nothing is outside here"
            )
        for transformation in connection.findall("ssc:LinearTransformation", NAMESPACES):
            raise UserError(
                f"{path}: the connection to {ends[2]}.{ends[3]} has a {transformation.tag.partition('}')[2]}, which is "
                "not supported; scale the port in a scenario instead"
            )
        last = known.get(ends[2], {}).get(_place(ends[3], known.get(ends[2], {}))[0])
        if last is not None and last.causality == "output":
            ends = [*ends[2:], *ends[:2]]  # SSP does not say which end is the output
        port, index = _place(ends[3], known.get(ends[2], {}))
        by_port[ends[2], port][index] = (ends[0], ends[1])
    order = {name: i for i, name in enumerate(known)}
    connections, split = [], defaultdict[str, dict[str, str]](dict)
    for (name, port), sources in by_port.items():
        for target, source in _joined(port, sources, name, known):
            if target != port:
                split[name][target] = target
            later = order.get(source[0], 0) > order.get(name, 0)
            connections.append({"from": ".".join(source), "to": f"{name}.{target}", "previous_step": later})
    return connections, split


def _place(connector: str, variables: Mapping[str, Variable]) -> tuple[str, int]:
    """Port and index of a connector; an unknown one is left to the wiring to refuse."""
    match = _ELEMENT.fullmatch(connector)
    if connector not in variables and match and match[1] in variables:
        return match[1], int(match[2])
    return connector, 0


def _joined(
    port: str, sources: Mapping[int, tuple[str, str]], name: str, known: Mapping[str, Mapping[str, Variable]]
) -> Iterator[tuple[str, tuple[str, str]]]:
    """(target port, (component, source port)): the whole array if it can be, else its elements."""
    variable = known.get(name, {}).get(port)
    places = {index: _place(source[1], known.get(source[0], {})) for index, source in sources.items()}
    components, ports = {source[0] for source in sources.values()}, {place[0] for place in places.values()}
    if variable is None or variable.shape is None:
        yield from ((port, source) for source in sources.values())
        return
    if len(components) == len(ports) == 1 and all(places.get(i, ("", 0))[1] == i for i in range(1, variable.size + 1)):
        [component], [source_port] = components, ports
        if known[component][source_port].size == variable.size:
            yield port, (component, source_port)
            return
    yield from ((f"{port}[{index}]", source) for index, source in sources.items())


def _whole(values: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Fields of the scenario as a whole, taken out of the parameters: faults, seed and step size."""
    fields: dict[str, Any] = {}
    for parameters in values.values():
        faults = {field: parameters.pop(name) for field, name in FAULT_PARAMETERS.items() if name in parameters}
        if "rotor" in faults:
            fields["faults"] = [_fault(faults, i) for i, rotor in enumerate(faults["rotor"]) if rotor]
        for name, field in _WHOLE.items():
            if name in parameters:
                value = parameters.pop(name)
                fields[field] = int(value) if name == "seed" else value
    return fields


def _fault(columns: Mapping[str, list[float]], slot: int) -> dict[str, Any]:
    """A fault from its slot; a field that holds what an unused one holds was not given."""
    fault: dict[str, Any] = {}
    for field, name in FAULT_PARAMETERS.items():
        value = columns[field][slot]
        if field in ("rotor", "onset_s", "loss_of_effectiveness") or value != FAULT_SLOT_STARTS[name][slot]:
            fault[field] = value
    fault["rotor"] = int(fault["rotor"])
    return fault | ({"profile": PROFILES[int(fault["profile"])]} if "profile" in fault else {})


def _stop_time(path: Path, root: ET.Element) -> float:
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    stop = float(experiment.get("stopTime", "nan")) if experiment is not None else math.nan
    if not math.isfinite(stop):
        raise UserError(f"{path}: its DefaultExperiment states no stopTime, add --set duration_s=60")
    return stop


def _step(root: ET.Element) -> dict[str, float]:
    algorithm = root.find(".//osp:FixedStepAlgorithm", NAMESPACES)
    return {"step_size_s": float(algorithm.get("baseStepSize", "nan"))} if algorithm is not None else {}


def _vehicle(top: ET.Element) -> dict[str, str]:
    for annotation in top.findall(f"ssd:Annotations/ssc:Annotation[@type='{ROTORDX}']/vehicle", NAMESPACES):
        if annotation.get("name") in vehicle_names():
            return {"vehicle": annotation.get("name", "")}
    return {}
