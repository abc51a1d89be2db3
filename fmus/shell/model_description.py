"""modelDescription.xml of FMI 2.0 and FMI 3.0 from a component's ports."""

from __future__ import annotations

import hashlib
import re
import uuid
from collections.abc import Iterable
from dataclasses import astuple
from xml.etree import ElementTree as ET

from rotordx.fmus.shell.ports import Component, Port

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
    table = [version, component.name, component.description]
    table += [astuple(p) for group in component.groups() for p in group[2]]
    table += [component.tunable_parameters, component.initial_outputs_from_inputs, component.constant_initial_outputs]
    digest = hashlib.sha256(repr(table).encode()).digest()
    return f"{{{uuid.UUID(bytes=digest[:16])}}}"


def fmi2_description(component: Component, version: str) -> bytes:
    """FMI 2.0: every element is a scalar variable; unknowns and dependencies are 1-based indices."""
    root = _root(component, version, fmiVersion="2.0", guid=token(component, version))
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=component.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
        canBeInstantiatedOnlyOncePerProcess="false",
        canNotUseMemoryManagementFunctions="true",
    )
    _units(root, component)
    for _, p, types in _enumerations(root, component):
        enumeration = ET.SubElement(ET.SubElement(types, "SimpleType", name=_type_name(p)), "Enumeration")
        _items(enumeration, p)
    _log_categories(root)
    _default_experiment(root)
    variables = ET.SubElement(root, "ModelVariables")
    for offset, causality, p in component.variables():
        for i, name in enumerate(p.element_names()):
            scalar = ET.SubElement(
                variables,
                "ScalarVariable",
                name=name,
                valueReference=str(offset + i),
                description=p.description,
                **_causality(component, causality, p),
            )
            if p.choices:
                ET.SubElement(scalar, "Enumeration", declaredType=_type_name(p), start=str(int(p.start[i])))
            else:
                start = {} if causality == "output" else {"start": repr(p.start[i])}
                ET.SubElement(scalar, "Real", unit=p.unit, **_range(p), **start)
    references = [(offset + i, causality) for offset, causality, p in component.variables() for i in range(p.size)]
    structure = ET.SubElement(root, "ModelStructure")
    outputs = ET.SubElement(structure, "Outputs")
    initial = ET.SubElement(structure, "InitialUnknowns")
    knowns = _initial_dependencies(component, ((reference + 1, causality) for reference, causality in references))
    for reference, causality in references:
        if causality == "output":
            ET.SubElement(outputs, "Unknown", index=str(reference + 1), dependencies="")
            ET.SubElement(initial, "Unknown", index=str(reference + 1), dependencies=knowns)
    return _document(root)


def fmi3_description(component: Component, version: str) -> bytes:
    """FMI 3.0: ports with several elements are arrays; unknowns and dependencies are value references."""
    root = _root(component, version, fmiVersion="3.0", instantiationToken=token(component, version))
    ET.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=component.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canBeInstantiatedOnlyOncePerProcess="false",
        hasEventMode="false",
    )
    _units(root, component)
    for _, p, types in _enumerations(root, component):
        _items(ET.SubElement(types, "EnumerationType", name=_type_name(p)), p)
    _log_categories(root)
    _default_experiment(root)
    variables = ET.SubElement(root, "ModelVariables")
    count = 0
    for offset, causality, p in component.variables():
        attributes = {
            "name": p.name,
            "valueReference": str(offset),
            "description": p.description,
            **_causality(component, causality, p),
        }
        if p.choices:
            attributes |= {"declaredType": _type_name(p), "start": str(int(p.start[0]))}
        else:
            attributes |= {"unit": p.unit, **_range(p)}
            if causality != "output":
                attributes["start"] = " ".join(map(repr, p.start))
        variable = ET.SubElement(variables, "Enumeration" if p.choices else "Float64", attributes)
        if p.shape is not None:
            ET.SubElement(variable, "Dimension", start=str(p.shape))
        count = offset + p.size
    ET.SubElement(
        variables,
        "Float64",
        name="time",
        valueReference=str(count),
        description="simulation time",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    structure = ET.SubElement(root, "ModelStructure")
    knowns = _initial_dependencies(component, ((offset, causality) for offset, causality, _ in component.variables()))
    outputs = [str(offset) for offset, causality, _ in component.variables() if causality == "output"]
    for reference in outputs:
        ET.SubElement(structure, "Output", valueReference=reference, dependencies="")
    for reference in outputs:
        ET.SubElement(structure, "InitialUnknown", valueReference=reference, dependencies=knowns)
    return _document(root)


def _root(component: Component, version: str, **attributes: str) -> ET.Element:
    return ET.Element(
        "fmiModelDescription",
        modelName=component.name,
        description=component.description,
        version=version,
        license="BSD-3-Clause",
        generationTool=f"rotordx {version}",
        variableNamingConvention="structured",
        **attributes,
    )


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


def _enumerations(root: ET.Element, component: Component) -> Iterable[tuple[int, Port, ET.Element]]:
    """(offset, port, TypeDefinitions) of every port with choices; the element exists only if there is one."""
    types = None
    for offset, _, p in component.variables():
        if p.choices:
            types = ET.SubElement(root, "TypeDefinitions") if types is None else types
            yield offset, p, types


def _items(element: ET.Element, p: Port) -> None:
    for value, choice in enumerate(p.choices):
        ET.SubElement(element, "Item", name=choice, value=str(value))


def _type_name(p: Port) -> str:
    return "".join(word.capitalize() for word in p.name.split("_"))


def _log_categories(root: ET.Element) -> None:
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="errors, always sent")
    ET.SubElement(categories, "Category", name="logEvents", description="life cycle, sent if debug logging is on")


def _default_experiment(root: ET.Element) -> None:
    from rotordx.fmus.shell.ports import STEP_SIZE

    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime=_STOP_TIME, stepSize=repr(STEP_SIZE.start[0]))


def _causality(component: Component, causality: str, p: Port) -> dict[str, str]:
    if causality == "parameter":
        tunable = component.tunable_parameters and p.name != "step_size"
        return {"causality": causality, "variability": "tunable" if tunable else "fixed", "initial": "exact"}
    if causality == "output":
        return {"causality": causality, "variability": "continuous", "initial": "calculated"}
    return {"causality": causality, "variability": "continuous"}


def _range(p: Port) -> dict[str, str]:
    bounds = {"min": p.minimum, "max": p.maximum}
    return {name: repr(float(value)) for name, value in bounds.items() if value is not None}


def _initial_dependencies(component: Component, references: Iterable[tuple[int, str]]) -> str:
    """What the outputs depend on in initialisation mode, as a list of references."""
    if component.constant_initial_outputs:
        return ""
    causalities = {"parameter", "input"} if component.initial_outputs_from_inputs else {"parameter"}
    return " ".join(str(reference) for reference, causality in references if causality in causalities)


def _document(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"
