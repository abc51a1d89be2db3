"""System Structure and Parameterization 1.0: a scenario's system as an archive that other tools fly.

SSP 1.0 knows scalars only, so that the FMUs in it are those of FMI 2. Elements stand in the order of computation; a
tool that steps them all with the values of the step before adds a step of delay to every connection that goes forward.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.fmus import load_component
from rotordx.fmus.shell.pack import pack
from rotordx.fmus.shell.ports import with_starts
from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator.component import Component
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export import fmu_export
from rotordx.orchestrator.export.fmu_compiler import chosen_platforms
from rotordx.orchestrator.layout import load_layout
from rotordx.orchestrator.parameters import parameter_values
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System
from rotordx.orchestrator.system_structure import NAMESPACES, OSP, ROTORDX
from rotordx.orchestrator.units import BASE_UNITS, Unit
from rotordx.orchestrator.variables import Element, Variable
from rotordx.orchestrator.wiring import EXTERNAL


def contents(scenario: Scenario) -> dict[str, bytes]:
    """Files of an SSP archive: name -> contents.

    Raises:
        UserError: the scenario is impossible, or SSP 1.0 cannot express it.
        ComponentError: an FMU cannot be loaded.
    """
    with System(_of_fmi2(scenario)) as system:
        names = {name: _scalars(name, system) for name in system.components}
        root = _root(scenario, system, names)
        written = {"SystemStructure.ssd": _document(root)}
        vehicle = load_vehicle(scenario.vehicle)
        values = parameter_values(scenario, system.settings(scenario), system.components, vehicle, vehicle)
        for name, component in system.components.items():
            written[f"resources/{name}.fmu"] = _fmu(scenario, system, name, values[name])
            written[f"resources/{name}.ssv"] = _parameter_set(name, component, values[name], names[name])
    return written


def _fmu(scenario: Scenario, system: System, name: str, values: Mapping[str, Sequence[Any]]) -> bytes:
    """Bytes of a component's FMU; one of ours is built anew if an enumeration does not start at its value.

    Other tools cannot set enumerations: Ecos and libcosim do not know them, so that no parameter set has one.
    """
    archive, parameters = system.archives[name], system.components[name].parameters
    enumerations = {key: elements[0] for key, elements in values.items() if parameters[key].choices}
    if all(parameters[key].start == (float(value),) for key, value in enumerations.items()):
        return archive.path.read_bytes()
    fmu = str(system.settings(scenario)[name].fmu)
    if fmu.endswith(".fmu"):
        raise UserError(f"components.{name}.parameters.{min(enumerations)}: other tools cannot set the enumeration, "
                        "leave it at its start value")  # fmt: skip
    component = load_component(fmu)
    started = dataclasses.replace(
        component, parameters=tuple(with_starts(c, enumerations) for c in component.parameters)
    )
    here = chosen_platforms(None, 2)
    files = fmu_export.contents(
        started, load_vehicle(scenario.vehicle), 2, here, with_sources=False, report=lambda _: None
    )
    packed = io.BytesIO()
    pack(packed, files)
    return packed.getvalue()


def _of_fmi2(scenario: Scenario) -> Scenario:
    """The scenario with packaged FMUs in FMI 2."""
    packaged = load_layout(scenario.system).components
    components = scenario.plain()["components"]
    for name in {*packaged, *scenario.diagnosers}:
        own = components.get(name, {})
        if not str(own.get("fmu") or (packaged[name].fmu if name in packaged else name)).endswith(".fmu"):
            components[name] = own | {"fmi": 2}
    return scenario.changed(components=components)


def _scalars(name: str, system: System) -> dict[int, str]:
    """Names of an FMU's variables by value reference; ours come first where variables share one."""
    variables = system.archives[name].description.modelVariables
    if system.archives[name].fmi != 2:
        raise UserError(f"components.{name} is an FMU of FMI 3, which SSP 1.0 does not know: use one of FMI 2")
    return {v.valueReference: v.name for v in variables if v.type == "Real"}


def _root(scenario: Scenario, system: System, names: Mapping[str, Mapping[int, str]]) -> ET.Element:
    attributes = {"version": "1.0", "name": scenario.name, "generationTool": "rotordx"}
    root = ET.Element(_tag("ssd:SystemStructureDescription"), attributes)
    top = ET.SubElement(root, _tag("ssd:System"), name=scenario.name, description=scenario.description)
    elements = ET.SubElement(top, _tag("ssd:Elements"))
    units: dict[str, Unit] = {}
    for name in system.wiring.order:
        component = system.components[name]
        source = {"name": name, "type": "application/x-fmu-sharedlibrary", "source": f"resources/{name}.fmu"}
        element = ET.SubElement(elements, _tag("ssd:Component"), source)
        connectors = ET.SubElement(element, _tag("ssd:Connectors"))
        for variable in [*component.inputs.values(), *component.outputs.values()]:
            unit = {"unit": variable.unit} if variable.measures else {}
            units |= {variable.unit: variable.measures} if variable.measures else {}
            for part in variable.elements:
                kind = {"name": names[name][part.reference], "kind": variable.causality}
                ET.SubElement(ET.SubElement(connectors, _tag("ssd:Connector"), kind), _tag("ssc:Real"), unit)
        bindings = ET.SubElement(element, _tag("ssd:ParameterBindings"))
        ET.SubElement(bindings, _tag("ssd:ParameterBinding"), source=f"resources/{name}.ssv")
    connections = ET.SubElement(top, _tag("ssd:Connections"))
    for connection in system.connections:
        for attributes, transformation in _connected(connection.source, connection.target, system.components, names):
            element = ET.SubElement(connections, _tag("ssd:Connection"), attributes)
            if transformation:
                element.set("suppressUnitConversion", "true")
                ET.SubElement(element, _tag("ssc:LinearTransformation"), transformation)
    annotation = ET.SubElement(ET.SubElement(top, _tag("ssd:Annotations")), _tag("ssc:Annotation"), type=ROTORDX)
    ET.SubElement(annotation, "vehicle", name=scenario.vehicle)
    _unit_definitions(root, units)
    _default_experiment(root, scenario)
    return root


def _connected(
    source: str, target: str, components: Mapping[str, Component], names: Mapping[str, Mapping[int, str]]
) -> Iterator[tuple[dict[str, str], dict[str, str]]]:
    """(ends, linear transformation if one is needed) of each pair of elements that a connection joins."""
    (writer, output), (reader, port) = (end.split(".", 1) for end in (source, target))
    if writer == EXTERNAL:
        raise UserError(f"the connection from {source} to {target} comes from outside, which an SSP cannot hold")
    starts, ends = _elements(components[writer].outputs, output), _elements(components[reader].inputs, port)
    for start, end in zip(starts, ends, strict=True):
        factor, offset = start.scale / end.scale, (start.offset - end.offset) / end.scale
        plain = (factor, offset) == (1.0, 0.0)
        yield (
            {
                "startElement": writer,
                "startConnector": names[writer][start.reference],
                "endElement": reader,
                "endConnector": names[reader][end.reference],
            },
            {} if plain else {"factor": repr(factor), "offset": repr(offset)},
        )


def _elements(ports: Mapping[str, Variable], name: str) -> tuple[Element, ...]:
    """Elements of a port, or the one that "port[1]" names."""
    if name in ports:
        return ports[name].elements
    whole, _, index = name.removesuffix("]").rpartition("[")
    return (ports[whole].elements[int(index) - 1],)


def _parameter_set(
    name: str, component: Component, values: Mapping[str, Sequence[Any]], names: Mapping[int, str]
) -> bytes:
    root = ET.Element(_tag("ssv:ParameterSet"), version="1.0", name="initialValues")
    parameters = ET.SubElement(root, _tag("ssv:Parameters"))
    for key, elements in values.items():
        variable = component.parameters[key]
        if variable.choices:
            continue  # see `_fmu`
        kind = variable.type if variable.type in ("Boolean", "String", "Integer") else "Real"
        scalars = [key] if variable.shape is None else [f"{key}[{i + 1}]" for i in range(variable.size)]
        for scalar, part, value in zip(scalars, variable.elements, elements, strict=True):
            own = names.get(part.reference, scalar) if kind == "Real" else scalar
            parameter = ET.SubElement(parameters, _tag("ssv:Parameter"), name=own)
            ET.SubElement(parameter, _tag(f"ssv:{kind}"), value=_text(kind, value))
    return _document(root)


def _text(kind: str, value: Any) -> str:
    if kind == "Integer":
        return str(int(value))
    if kind == "Boolean":
        return str(bool(value)).lower()
    return str(value) if kind == "String" else repr(float(value))


def _unit_definitions(root: ET.Element, units: Mapping[str, Unit]) -> None:
    listed = ET.SubElement(root, _tag("ssd:Units"))
    for name, unit in sorted(units.items()):
        base = {b: str(unit.exponents[b]) for b in BASE_UNITS if b in unit.exponents}
        ET.SubElement(ET.SubElement(listed, _tag("ssc:Unit"), name=name), _tag("ssc:BaseUnit"), base)


def _default_experiment(root: ET.Element, scenario: Scenario) -> None:
    """Duration, and the step size, which SSP leaves to an annotation."""
    times = {"startTime": "0", "stopTime": repr(scenario.duration_s)}
    experiment = ET.SubElement(root, _tag("ssd:DefaultExperiment"), times)
    annotation = ET.SubElement(ET.SubElement(experiment, _tag("ssd:Annotations")), _tag("ssc:Annotation"), type=OSP)
    algorithm = ET.SubElement(annotation, _tag("osp:Algorithm"))
    ET.SubElement(algorithm, _tag("osp:FixedStepAlgorithm"), baseStepSize=repr(scenario.step_size_s))


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{local}"


def _document(root: ET.Element) -> bytes:
    for prefix, uri in NAMESPACES.items():
        ET.register_namespace(prefix, uri)
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"
