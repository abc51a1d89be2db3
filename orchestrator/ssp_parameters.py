"""Values that the parameter bindings of an SSP archive give to the variables of its FMUs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.orchestrator.ssp_archive import NAMESPACES, SspArchive, tag
from rotordx.orchestrator.units import Unit
from rotordx.orchestrator.variables import Variable

_SET, _MAPPING = "application/x-ssp-parameter-set", "application/x-ssp-parameter-mapping"


@dataclass(frozen=True)
class Affine:
    """result = factor * value + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def of(self, value: float) -> float:
        """The result for a value, which stays as it is to the last bit where nothing is to be done."""
        return value if self == Affine() else self.factor * value + self.offset

    def after(self, first: Affine) -> Affine:
        """Both, `first` first."""
        return Affine(self.factor * first.factor, self.of(first.offset))


@dataclass(frozen=True)
class Given:
    """A value as an archive states it."""

    text: str
    unit: Unit | None = None  #: None: not stated, or not to be converted
    transformation: Affine = Affine()  #: after the conversion of units

    def value(self, archive: SspArchive, variable: Variable, name: str) -> Any:
        """The value for a variable of an FMU, in its unit.

        Raises:
            UserError: it does not fit.
        """
        if self.transformation != Affine() and not variable.is_real:
            raise archive.error(f"the parameter {name} has a LinearTransformation, but only reals can be transformed")
        if variable.type == "String" or self.text in variable.choices:
            return self.text
        if variable.type == "Boolean":
            if self.text not in ("true", "false", "1", "0"):
                raise archive.error(f"the parameter {name} is {self.text!r}, but must be true or false")
            return self.text in ("true", "1")
        try:
            number = float(self.text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise archive.error(f"the parameter {name} is {self.text!r}, but must be a finite {variable.type}")
        converted = conversion(archive, self.unit, variable.measures, f"the parameter {name}")
        return self.transformation.after(converted).of(number)


def conversion(archive: SspArchive, source: Unit | None, target: Unit | None, where: str) -> Affine:
    """From one unit to the other; nothing is converted if one of them is not known.

    Raises:
        UserError: they measure different quantities.
    """
    if source is None or target is None or source == target:
        return Affine()
    if source.exponents != target.exponents:
        raise archive.error(
            f"{where} is in {source.name_in_si} where {target.name_in_si} is needed (SI): give it in the right unit"
        )
    return Affine(source.factor / target.factor, (source.offset - target.offset) / target.factor)


def transformation(archive: SspArchive, element: ET.Element, where: str) -> Affine:
    """The linear transformation that a connection or the entry of a mapping has.

    Raises:
        UserError: it has another one, or it is impossible.
    """
    for child in element:
        _, _, kind = child.tag.rpartition("}")
        if child.tag == tag("ssc:LinearTransformation"):
            try:
                result = Affine(float(child.get("factor", "1")), float(child.get("offset", "0")))
            except ValueError as error:
                raise archive.error(f"the LinearTransformation of {where} cannot be read: {error}") from error
            if result.factor == 0 or not math.isfinite(result.factor) or not math.isfinite(result.offset):
                raise archive.error(f"the LinearTransformation of {where} must have finite numbers and no factor of 0")
            return result
        if kind.endswith("Transformation"):
            raise archive.error(f"{where} has the {kind}, which is not supported: use a LinearTransformation")
    return Affine()


def bound(archive: SspArchive, element: ET.Element) -> dict[str, Given]:
    """What the parameter bindings of an element state, by the name within the element; the last one counts.

    Raises:
        UserError: a binding cannot be read or is of an unknown kind.
    """
    values: dict[str, Given] = {}
    for binding in element.findall("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
        where = f"a parameter binding of {element.get('name')}"
        parameters = _part(archive, binding, "ssv:ParameterSet", _SET, where)
        if parameters is None:
            continue
        prefix = binding.get("prefix", "")
        stated = {prefix + name: given for name, given in _stated(archive, parameters)}
        mapping = binding.find("ssd:ParameterMapping", NAMESPACES)
        if mapping is not None:
            entries = _part(archive, mapping, "ssm:ParameterMapping", _MAPPING, f"the mapping of {where}")
            stated = dict(_mapped(archive, stated, entries)) if entries is not None else {}
        values |= stated
    return values


def _part(archive: SspArchive, holder: ET.Element, root: str, kind: str, where: str) -> ET.Element | None:
    """The document that a binding or a mapping holds or names."""
    if holder.get("type", kind) != kind:
        raise archive.error(f"{where} is of the type {holder.get('type')!r}, supported is {kind}")
    source = holder.get("source")
    if source is None:
        found = next(holder.iter(tag(root)), None)
        if found is not None:
            archive.check(found, root, where)
        return found
    if holder.get("sourceBase", "SSD") != "SSD":
        raise archive.error(f"{where} lies within a component, which is not supported: put {source!r} beside the FMU")
    return archive.document(source, root)


def _stated(archive: SspArchive, parameters: ET.Element) -> Iterator[tuple[str, Given]]:
    units = archive.units(parameters.find("ssv:Units", NAMESPACES))
    for parameter in parameters.findall("ssv:Parameters/ssv:Parameter", NAMESPACES):
        for value in parameter:
            if value.get("value") is not None:
                yield parameter.get("name", ""), Given(value.get("value", ""), units.get(value.get("unit", "")))


def _mapped(archive: SspArchive, stated: Mapping[str, Given], entries: ET.Element) -> Iterator[tuple[str, Given]]:
    """The values under their new names; what has no entry falls away."""
    for entry in entries.findall("ssm:MappingEntry", NAMESPACES):
        source, target = entry.get("source", ""), entry.get("target", "")
        change = transformation(archive, entry, f"the mapping of {source} to {target}")
        if source in stated:
            given = replace(stated[source], transformation=change)
            suppressed = entry.get("suppressUnitConversion", "false") in ("true", "1")
            yield target, replace(given, unit=None) if suppressed else given
