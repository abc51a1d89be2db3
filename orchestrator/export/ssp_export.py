"""System Structure and Parameterization 1.0: a scenario's system as an archive that other tools fly.

SSP 1.0 knows scalars only, so that the FMUs in it are those of FMI 2. Elements stand in the order of computation; a
tool that steps them all with the values of the step before adds a step of delay to every connection that goes forward.

Names and annotations are also what OMSimulator reads: elements and connectors of the system are identifiers of C, and
its annotation is the first one of the system.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.fmus import load_component
from rotordx.fmus.shell.pack import pack
from rotordx.fmus.shell.ports import started
from rotordx.fmus.vehicles import Vehicle, load_vehicle
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export import fmu_export
from rotordx.orchestrator.export.fmu_compiler import chosen_platforms
from rotordx.orchestrator.layout import ComponentSettings, load_layout
from rotordx.orchestrator.parameters import parameter_values
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.ssp_archive import NAMESPACES, OPENMODELICA, OSP, ROTORDX, tag
from rotordx.orchestrator.system import System
from rotordx.orchestrator.units import BASE_UNITS, Unit, declared_units
from rotordx.orchestrator.variables import Element, Variable, read_variables
from rotordx.orchestrator.wiring import EXTERNAL

Values = Mapping[str, Sequence[Any]]  # elements of parameters
Parameter = tuple[str, Variable, Any]  # name in the FMU, variable, value
_TYPES = ("Real", "Integer", "Boolean", "String")


def contents(
    scenario: Scenario, *, outputs: bool = False, report: Callable[[str], None] = lambda _: None
) -> dict[str, bytes]:
    """Files of an SSP archive: name -> contents.

    Args:
        scenario: what is flown.
        outputs: whether all outputs of the FMUs are outputs of the system too, as a container FMU needs it; Ecos and
            libcosim refuse such archives.
        report: is told what takes time.

    Raises:
        UserError: the scenario is impossible, or SSP 1.0 cannot express it.
        ComponentError: an FMU cannot be loaded.
        RunError: an FMU cannot be compiled.
    """
    written: dict[str, bytes] = {}
    with System(_of_fmi2(scenario)) as system:
        settings = system.settings(scenario)
        descriptions = {name: _Described(name, system, settings[name]) for name in system.components}
        written["SystemStructure.ssd"] = _document(_root(scenario, system, descriptions, outputs))
        vehicle = load_vehicle(scenario.vehicle)
        values = parameter_values(scenario, settings, system.components, vehicle, vehicle)
        for i, (name, described) in enumerate(descriptions.items(), start=1):
            fmu, given = str(settings[name].fmu), values[name]
            if fmu.endswith(".fmu"):
                parameters = list(described.parameter_elements(given))
                content = _foreign(name, system.archives[name].path, parameters)
            else:
                starts = {key: variable.start for key, variable in described.parameters.items() if variable.start}
                parameters = list(described.parameter_elements(starts | given))
                place = f"{i} of {len(descriptions)}: "
                content = _own(fmu, vehicle, parameters, partial(_prefixed, report, place))
            written[f"resources/{name}.fmu"] = content
            written[f"resources/{name}.ssv"] = _parameter_set(parameters)
    return written


def _prefixed(report: Callable[[str], None], prefix: str, text: str) -> None:
    report(prefix + text)


class _Described:
    """A component as its FMU describes it, which an isolated one does not."""

    def __init__(self, name: str, system: System, settings: ComponentSettings):
        archive, component = system.archives[name], system.components[name]
        if archive.fmi != 2:
            raise UserError(f"components.{name} is an FMU of FMI 3, which SSP 1.0 does not know: use one of FMI 2")
        variables = read_variables(archive.description, settings.ports, name)
        self.inputs = {port: variables[port] for port in component.inputs}
        self.outputs = {port: variables[port] for port in component.outputs}
        self.parameters = {port: variables[port] for port in component.parameters}
        self._declared = {(v.type, v.valueReference): v for v in reversed(archive.description.modelVariables)}
        self._units = declared_units(archive.description)

    def name(self, variable: Variable, element: Element) -> str:
        """Of an element of a port in the FMU."""
        name: str = self._declared[variable.type, element.reference].name
        return name

    def unit(self, variable: Variable, element: Element) -> tuple[str, Unit] | None:
        """Of the FMU's values; None if it is not known."""
        declared = self._declared[variable.type, element.reference]
        name: str = declared.unit or (declared.declaredType.unit if declared.declaredType else None) or ""
        unit = self._units.get(name)
        return (name, unit) if unit is not None else None

    def parameter_elements(self, values: Values) -> Iterator[Parameter]:
        """Each element of parameters."""
        for key, elements in values.items():
            variable = self.parameters[key]
            for element, value in zip(variable.elements, elements, strict=True):
                yield self.name(variable, element), variable, value


def _own(fmu: str, vehicle: Vehicle, parameters: Sequence[Parameter], report: Callable[[str], None]) -> bytes:
    """One of our FMUs, whose parameters start at their values: some tools take no notice of parameter sets."""
    component = started(load_component(fmu), {name: float(value) for name, _, value in parameters})
    files = fmu_export.contents(component, vehicle, 2, chosen_platforms(None, 2), with_sources=False, report=report)
    packed = io.BytesIO()
    pack(packed, files)
    return packed.getvalue()


def _foreign(name: str, path: Path, parameters: Sequence[Parameter]) -> bytes:
    """An FMU of another tool as it is.

    Other tools cannot set enumerations: Ecos and libcosim do not know them, so that no parameter set has one.
    """
    for key, variable, value in parameters:
        if variable.choices and variable.start != (float(value),):
            raise UserError(f"components.{name}.parameters.{key}: other tools cannot set the enumeration, "
                            "leave it at its start value")  # fmt: skip
    return path.read_bytes()


def _of_fmi2(scenario: Scenario) -> Scenario:
    """The scenario with packaged FMUs in FMI 2."""
    packaged = load_layout(scenario.system).components
    components = scenario.plain()["components"]
    for name in {*packaged, *scenario.diagnosers}:
        own = components.get(name, {})
        if not str(own.get("fmu") or (packaged[name].fmu if name in packaged else name)).endswith(".fmu"):
            components[name] = own | {"fmi": 2}
    return scenario.changed(components=components)


def _root(scenario: Scenario, system: System, descriptions: Mapping[str, _Described], outputs: bool) -> ET.Element:
    name = _identifier(scenario.name)
    attributes = {"version": "1.0", "name": name, "generationTool": "rotordx"}
    root = ET.Element(tag("ssd:SystemStructureDescription"), attributes)
    top = ET.SubElement(root, tag("ssd:System"), name=name, description=scenario.description)
    own = ET.SubElement(top, tag("ssd:Connectors")) if outputs else None
    elements = ET.SubElement(top, tag("ssd:Elements"))
    connections = ET.SubElement(top, tag("ssd:Connections"))
    units: dict[str, Unit] = {}
    taken = set(system.wiring.order)
    for component in system.wiring.order:
        described = descriptions[component]
        source = {"name": component, "type": "application/x-fmu-sharedlibrary", "source": f"resources/{component}.fmu"}
        element = ET.SubElement(elements, tag("ssd:Component"), source | {"implementation": "CoSimulation"})
        connectors = ET.SubElement(element, tag("ssd:Connectors"))
        for variable in [*described.inputs.values(), *described.outputs.values()]:
            for part in variable.elements:
                unit = described.unit(variable, part)
                if unit and units.setdefault(*unit) != unit[1]:
                    unit = None  # another FMU means something else by this name
                connector = described.name(variable, part)
                _connector(connectors, connector, variable, unit)
                if own is not None and variable.causality == "output":
                    outside = _free_name(_identifier(f"{component}_{connector}"), taken)
                    _connector(own, outside, variable, unit)
                    ends = {"startElement": component, "startConnector": connector, "endConnector": outside}
                    ET.SubElement(connections, tag("ssd:Connection"), ends)
        bindings = ET.SubElement(element, tag("ssd:ParameterBindings"))
        ET.SubElement(bindings, tag("ssd:ParameterBinding"), source=f"resources/{component}.ssv")
    for connection in system.connections:
        for attributes, transformation in _connected(connection.source, connection.target, descriptions):
            written = ET.SubElement(connections, tag("ssd:Connection"), attributes)
            if transformation:
                written.set("suppressUnitConversion", "true")
                ET.SubElement(written, tag("ssc:LinearTransformation"), transformation)
    for parent in [top, *elements]:
        for child in [c for c in parent if len(c) == 0]:  # which the schema does not allow
            parent.remove(child)
    _annotations(top, scenario)
    _unit_definitions(root, units)
    _default_experiment(root, scenario)
    return root


def _identifier(name: str) -> str:
    """A name as an identifier of C."""
    words = re.sub(r"[^A-Za-z0-9_]+", "_", name).rstrip("_")
    return words if re.match("[A-Za-z]", words) else f"s{words}"


def _free_name(name: str, taken: set[str]) -> str:
    """The name, or with a number the first one that is not taken; it is taken from now on."""
    number, free = 2, name
    while free in taken:
        number, free = number + 1, f"{name}_{number}"
    taken.add(free)
    return free


def _connector(parent: ET.Element, name: str, variable: Variable, unit: tuple[str, Unit] | None) -> None:
    connector = ET.SubElement(parent, tag("ssd:Connector"), name=name, kind=variable.causality)
    kind = variable.type if variable.type in _TYPES else "Integer"  # as FMI 2 passes enumerations
    ET.SubElement(connector, tag(f"ssc:{kind}"), {"unit": unit[0]} if unit and kind == "Real" else {})


def _connected(
    source: str, target: str, descriptions: Mapping[str, _Described]
) -> Iterator[tuple[dict[str, str], dict[str, str]]]:
    """(ends, linear transformation if one is needed) of each pair of elements that a connection joins."""
    (writer, output), (reader, port) = (end.split(".", 1) for end in (source, target))
    if writer == EXTERNAL:
        raise UserError(f"the connection from {source} to {target} comes from outside, which an SSP cannot hold")
    from_, to = descriptions[writer], descriptions[reader]
    written, starts = _elements(from_.outputs, output)
    read, ends = _elements(to.inputs, port)
    for start, end in zip(starts, ends, strict=True):
        factor, offset = start.scale / end.scale, (start.offset - end.offset) / end.scale
        plain = (factor, offset) == (1.0, 0.0)
        units = [unit[1] for unit in (from_.unit(written, start), to.unit(read, end)) if unit]
        converted = len(units) == 2 and units[0] != units[1]
        yield (
            {
                "startElement": writer,
                "startConnector": from_.name(written, start),
                "endElement": reader,
                "endConnector": to.name(read, end),
            },
            {} if plain and not converted else {"factor": repr(factor), "offset": repr(offset)},
        )


def _elements(ports: Mapping[str, Variable], name: str) -> tuple[Variable, tuple[Element, ...]]:
    """A port and its elements, or the one that "port[1]" names."""
    if name in ports:
        return ports[name], ports[name].elements
    whole, _, index = name.removesuffix("]").rpartition("[")
    return ports[whole], (ports[whole].elements[int(index) - 1],)


def _parameter_set(values: Sequence[Parameter]) -> bytes:
    root = ET.Element(tag("ssv:ParameterSet"), version="1.0", name="initialValues")
    parameters = ET.SubElement(root, tag("ssv:Parameters"))
    for name, variable, value in values:
        if variable.choices:
            continue  # see `_foreign`
        kind = variable.type if variable.type in _TYPES else "Real"
        parameter = ET.SubElement(parameters, tag("ssv:Parameter"), name=name)
        ET.SubElement(parameter, tag(f"ssv:{kind}"), value=_text(kind, value))
    return _document(root)


def _text(kind: str, value: Any) -> str:
    if kind == "Integer":
        return str(int(value))
    if kind == "Boolean":
        return str(bool(value)).lower()
    return str(value) if kind == "String" else repr(float(value))


def _annotations(top: ET.Element, scenario: Scenario) -> None:
    """The step size for OMSimulator, which reads the first annotation only, and the vehicle for rotordx."""
    listed = ET.SubElement(top, tag("ssd:Annotations"))
    annotation = ET.SubElement(listed, tag("ssc:Annotation"), type=OPENMODELICA)
    information = ET.SubElement(ET.SubElement(annotation, tag("oms:Annotations")), tag("oms:SimulationInformation"))
    master = {"description": "oms-ma", "stepSize": repr(scenario.step_size_s)}
    tolerances = {"absoluteTolerance": "0.0001", "relativeTolerance": "0.0001"}
    ET.SubElement(information, tag("oms:FixedStepMaster"), master | tolerances)
    annotation = ET.SubElement(listed, tag("ssc:Annotation"), type=ROTORDX)
    ET.SubElement(annotation, "vehicle", name=scenario.vehicle)


def _unit_definitions(root: ET.Element, units: Mapping[str, Unit]) -> None:
    if not units:
        return
    listed = ET.SubElement(root, tag("ssd:Units"))
    for name, unit in sorted(units.items()):
        base = {b: str(unit.exponents[b]) for b in BASE_UNITS if b in unit.exponents}
        base |= {"factor": repr(unit.factor)} if unit.factor != 1 else {}
        base |= {"offset": repr(unit.offset)} if unit.offset else {}
        ET.SubElement(ET.SubElement(listed, tag("ssc:Unit"), name=name), tag("ssc:BaseUnit"), base)


def _default_experiment(root: ET.Element, scenario: Scenario) -> None:
    """Duration, and the step size, which SSP leaves to an annotation."""
    times = {"startTime": "0", "stopTime": repr(scenario.duration_s)}
    experiment = ET.SubElement(root, tag("ssd:DefaultExperiment"), times)
    annotation = ET.SubElement(ET.SubElement(experiment, tag("ssd:Annotations")), tag("ssc:Annotation"), type=OSP)
    algorithm = ET.SubElement(annotation, tag("osp:Algorithm"))
    ET.SubElement(algorithm, tag("osp:FixedStepAlgorithm"), baseStepSize=repr(scenario.step_size_s))


def _document(root: ET.Element) -> bytes:
    for prefix, uri in NAMESPACES.items():
        ET.register_namespace(prefix, uri)
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"
