"""modelDescription.xml of FMI 2.0 and FMI 3.0 from a component's ports."""

from __future__ import annotations

import hashlib
import re
import uuid
from collections.abc import Iterator
from dataclasses import astuple
from xml.etree import ElementTree as ET

from rotordx.fmus.shell.ports import STEP_SIZE, Component, Port

#: Exponents of the SI base units (and rad) in the units that port declarations use.
_UNITS = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "mol": {"mol": 1},
    "cd": {"cd": 1},
    "rad": {"rad": 1},
    "1": {},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}

#: Default duration of an importer's simulation [s]; nothing depends on it.
_STOP_TIME = "1"


def base_unit(unit: str) -> dict[str, int] | None:
    """Exponents of the base units in a unit such as "kg.m2", "1/s" or "m/s2"; what follows "/" is divided by.

    None for a list of units ("m/s2, rad/s2": the elements of an array differ), which FMI leaves undefined.

    Raises:
        ValueError: if the unit is not one that this table knows.
    """
    if ", " in unit:
        for part in unit.split(", "):
            base_unit(part)
        return None
    exponents: dict[str, int] = {}
    for sign, product in zip((1, -1), unit.split("/"), strict=False):
        for factor in product.strip("()").split("."):
            match = re.fullmatch(r"(1|[A-Za-z]+)(\d*)", factor)
            if match is None or match[1] not in _UNITS or unit.count("/") > 1:
                raise ValueError(f"unit {unit!r} is not a product of powers of {', '.join(_UNITS)}")
            for name, exponent in _UNITS[match[1]].items():
                exponents[name] = exponents.get(name, 0) + sign * exponent * int(match[2] or 1)
    return {name: exponent for name, exponent in exponents.items() if exponent}


def token(component: Component, version: str) -> str:
    """GUID of a component: a hash of its declarations and the version, the same in every build."""
    ports = [(offset, causality, astuple(p)) for offset, causality, p in component.variables()]
    flags = [component.tunable_parameters, component.initial_outputs_from_inputs, component.constant_initial_outputs]
    digest = hashlib.sha256(repr((version, component.name, component.description, ports, flags)).encode()).digest()
    return f"{{{uuid.UUID(bytes=digest[:16])}}}"


def fmi2_description(component: Component, version: str) -> bytes:
    """FMI 2.0: every element is a scalar variable; unknowns and dependencies are 1-based indices."""
    root = _root(component, version, {"fmiVersion": "2.0", "guid": token(component, version)})
    capabilities = ("canGetAndSetFMUstate", "canSerializeFMUstate", "canNotUseMemoryManagementFunctions")
    _co_simulation(root, component, capabilities)
    _units(root, component)
    for p, types in _enumerations(root, component):
        _items(ET.SubElement(ET.SubElement(types, "SimpleType", name=_type_name(p)), "Enumeration"), p)
    _log_categories(root)
    _default_experiment(root, component)
    variables = ET.SubElement(root, "ModelVariables")
    for offset, causality, p in component.variables():
        for i, name in enumerate(p.element_names()):
            variable = {"name": name, "valueReference": str(offset + i)} | _variable(component, causality, p)
            scalar = ET.SubElement(variables, "ScalarVariable", variable)
            ET.SubElement(scalar, "Enumeration" if p.choices else "Real", _value(causality, p, p.start[i : i + 1]))
    indices = [(str(offset + i + 1), c) for offset, c, p in component.variables() for i in range(p.size)]
    knowns = _initial_dependencies(component, indices)
    structure = ET.SubElement(root, "ModelStructure")
    for element, dependencies in (("Outputs", ""), ("InitialUnknowns", knowns)):
        unknowns = ET.SubElement(structure, element)
        for index, causality in indices:
            if causality == "output":
                ET.SubElement(unknowns, "Unknown", index=index, dependencies=dependencies)
    return _document(root)


def fmi3_description(component: Component, version: str) -> bytes:
    """FMI 3.0: ports with several elements are arrays; unknowns and dependencies are value references."""
    root = _root(component, version, {"fmiVersion": "3.0", "instantiationToken": token(component, version)})
    _co_simulation(root, component, ("canGetAndSetFMUState", "canSerializeFMUState"))
    _units(root, component)
    for p, types in _enumerations(root, component):
        _items(ET.SubElement(types, "EnumerationType", name=_type_name(p)), p)
    _log_categories(root)
    _default_experiment(root, component)
    variables = ET.SubElement(root, "ModelVariables")
    for offset, causality, p in component.variables():
        attributes = {"name": p.name, "valueReference": str(offset)} | _variable(component, causality, p)
        attributes |= _value(causality, p, p.start)
        variable = ET.SubElement(variables, "Enumeration" if p.choices else "Float64", attributes)
        if p.shape is not None:
            ET.SubElement(variable, "Dimension", start=str(p.shape))
    time = {"name": "time", "valueReference": str(sum(p.size for _, _, p in component.variables()))}
    time |= {"description": "simulation time", "causality": "independent", "variability": "continuous", "unit": "s"}
    ET.SubElement(variables, "Float64", time)
    references = [(str(offset), causality) for offset, causality, _ in component.variables()]
    knowns = _initial_dependencies(component, references)
    structure = ET.SubElement(root, "ModelStructure")
    for element, dependencies in (("Output", ""), ("InitialUnknown", knowns)):
        for reference, causality in references:
            if causality == "output":
                ET.SubElement(structure, element, valueReference=reference, dependencies=dependencies)
    return _document(root)


def _root(component: Component, version: str, attributes: dict[str, str]) -> ET.Element:
    common = {
        "modelName": component.name,
        "description": component.description,
        "version": version,
        "license": "BSD-3-Clause",
        "generationTool": f"rotordx {version}",
        "variableNamingConvention": "structured",
    }
    return ET.Element("fmiModelDescription", attributes | common)


def _co_simulation(root: ET.Element, component: Component, capabilities: tuple[str, ...]) -> None:
    attributes = {"modelIdentifier": component.name, "canBeInstantiatedOnlyOncePerProcess": "false"}
    attributes |= dict.fromkeys(("canHandleVariableCommunicationStepSize", *capabilities), "true")
    ET.SubElement(root, "CoSimulation", attributes)


def _units(root: ET.Element, component: Component) -> None:
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in sorted({"s"} | {p.unit for _, _, p in component.variables() if not p.choices}):
        try:
            exponents = base_unit(unit)
        except ValueError as error:
            raise ValueError(f"component {component.name}: {error}") from None
        element = ET.SubElement(definitions, "Unit", name=unit)
        if exponents is not None:
            ET.SubElement(element, "BaseUnit", {name: str(exponent) for name, exponent in exponents.items()})


def _enumerations(root: ET.Element, component: Component) -> Iterator[tuple[Port, ET.Element]]:
    """(port, TypeDefinitions) of every port with choices; the element exists only if there is one."""
    types = None
    for _, _, p in component.variables():
        if p.choices:
            types = ET.SubElement(root, "TypeDefinitions") if types is None else types
            yield p, types


def _items(element: ET.Element, p: Port) -> None:
    for value, choice in enumerate(p.choices):
        ET.SubElement(element, "Item", name=choice, value=str(value))


def _type_name(p: Port) -> str:
    return "".join(word.capitalize() for word in p.name.split("_"))


def _log_categories(root: ET.Element) -> None:
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="errors, always sent")
    ET.SubElement(categories, "Category", name="logEvents", description="life cycle, sent if debug logging is on")


def _default_experiment(root: ET.Element, component: Component) -> None:
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=_STOP_TIME, stepSize=repr(component.step_size))


def _variable(component: Component, causality: str, p: Port) -> dict[str, str]:
    attributes = {"description": p.description, "causality": causality, "variability": "continuous"}
    if causality == "parameter":
        tunable = component.tunable_parameters and p.name != STEP_SIZE.name
        attributes |= {"variability": "tunable" if tunable else "fixed", "initial": "exact"}
    if causality == "output":
        attributes["initial"] = "calculated"
    return attributes


def _value(causality: str, p: Port, start: tuple[float, ...]) -> dict[str, str]:
    """Type, range and start value; outputs are calculated, so that they have none."""
    if p.choices:
        return {"declaredType": _type_name(p), "start": str(int(start[0]))}
    attributes = {"unit": p.unit}
    attributes |= {k: repr(float(v)) for k, v in (("min", p.minimum), ("max", p.maximum)) if v is not None}
    return attributes if causality == "output" else attributes | {"start": " ".join(map(repr, start))}


def _initial_dependencies(component: Component, references: list[tuple[str, str]]) -> str:
    """Out of (reference, causality) those that the outputs depend on in initialisation mode."""
    if component.constant_initial_outputs:
        return ""
    causalities = {"parameter", "input"} if component.initial_outputs_from_inputs else {"parameter"}
    return " ".join(reference for reference, causality in references if causality in causalities)


def _document(root: ET.Element) -> bytes:
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"
