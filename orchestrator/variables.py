"""Variables of an FMU as ports: arrays whole and values in SI units, however the FMU has them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.layout import PortMap
from rotordx.orchestrator.units import Unit, declared_units, unit_of_name


@dataclass(frozen=True)
class Access:
    """The pair of FMI functions that sets and gets the values of a type, and what a value may be."""

    suffix: str  #: of the functions' names, for example "Int32" of fmi3SetInt32 and fmi3GetInt32
    memory: str  #: of a value, as NumPy calls it
    lowest: float = -math.inf  #: of integers, the smallest and the largest that is a double and fits
    highest: float = math.inf

    @property
    def is_real(self) -> bool:
        """Whether values are floating-point numbers, which can have a unit."""
        return self.memory in ("f8", "f4")


def _integers(suffix: str, memory: str) -> Access:
    limits = np.iinfo(memory)
    highest = float(limits.max)
    return Access(suffix, memory, float(limits.min), highest if highest <= limits.max else np.nextafter(highest, 0.0))


#: FMI version -> type -> how values are set and got; of String, Binary and Clock they are no numbers
ACCESS = {
    2: {
        "Real": Access("Real", "f8"),
        "Integer": _integers("Integer", "i4"),
        "Enumeration": _integers("Integer", "i4"),
        "Boolean": Access("Boolean", "i4", 0.0, 1.0),
    },
    3: {
        "Float64": Access("Float64", "f8"),
        "Float32": Access("Float32", "f4"),
        **{
            f"{sign.upper()}Int{8 * n}": _integers(f"{sign.upper()}Int{8 * n}", f"{sign or 'i'}{n}")
            for n in (1, 2, 4, 8)
            for sign in ("", "u")
        },
        "Enumeration": _integers("Int64", "i8"),
        "Boolean": Access("Boolean", "u1", 0.0, 1.0),
    },
}
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True)
class Element:
    """One value of a port: the `index`-th of the `count` values behind a value reference of the FMU.

    The port's value is scale * the FMU's value + offset.
    """

    reference: int
    index: int = 0
    count: int = 1
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Variable:
    """A scalar (`shape` is None) or an array of `shape` elements."""

    name: str
    type: str  #: of FMI: "Real", "Float64", "Enumeration", ...
    access: Access | None  #: None if values are no numbers
    causality: str
    unit: str  #: of the port's values; of a parameter, which is not converted, the FMU's
    description: str
    shape: int | None
    elements: tuple[Element, ...]
    start: tuple[float, ...] | None  #: numbers only
    minimum: float
    maximum: float
    choices: Mapping[str, int]  #: names and values of an enumeration
    measures: Unit | None = None  #: the FMU's unit, None if it is not known

    @property
    def references(self) -> tuple[int, ...]:
        """Value references: one for a whole array of FMI 3, one for each element in FMI 2."""
        return tuple(dict.fromkeys(element.reference for element in self.elements))

    @property
    def size(self) -> int:
        """Number of elements."""
        return 1 if self.shape is None else self.shape

    @property
    def is_number(self) -> bool:
        """Whether it can be connected and logged."""
        return self.access is not None

    @property
    def is_real(self) -> bool:
        """Whether it can have a unit."""
        return self.access is not None and self.access.is_real


@dataclass(frozen=True)
class Call:
    """One call that sets or gets all values of one type, and how those of some ports lie in it."""

    access: Access
    references: tuple[int, ...]
    size: int  #: number of values of the call
    elements: tuple[int, ...]  #: those that have this type, counted over the elements of all ports
    places: tuple[int, ...]  #: of each of these elements among the values of the call
    scale: tuple[float, ...]  #: value of the element = scale * value of the call + offset
    offset: tuple[float, ...]

    @classmethod
    def all_for(cls, variables: Iterable[Variable]) -> list[Call]:
        """The calls for these ports, which must be numbers: one for each type among them."""
        by_access: dict[Access, list[tuple[int, Element]]] = {}
        ports = [(variable.access, element) for variable in variables for element in variable.elements]
        for number, (access, element) in enumerate(ports):
            assert access is not None
            by_access.setdefault(access, []).append((number, element))
        return [cls._of(access, numbered) for access, numbered in by_access.items()]

    @classmethod
    def _of(cls, access: Access, numbered: Sequence[tuple[int, Element]]) -> Call:
        first, size = {}, 0
        for _, element in numbered:
            if element.reference not in first:
                first[element.reference] = size
                size += element.count
        return cls(
            access=access,
            references=tuple(first),
            size=size,
            elements=tuple(number for number, _ in numbered),
            places=tuple(first[element.reference] + element.index for _, element in numbered),
            scale=tuple(element.scale for _, element in numbered),
            offset=tuple(element.offset for _, element in numbered),
        )

    @property
    def converts(self) -> bool:
        """Whether the elements have a scale or an offset."""
        return set(self.scale) != {1.0} or any(self.offset)


def read_variables(description: Any, ports: Mapping[str, PortMap], component: str) -> dict[str, Variable]:
    """Variables of a model description by port name; inputs and outputs in SI units, as far as theirs are known.

    Args:
        description: fmpy.model_description.ModelDescription.
        ports: names of ports and what they consist of.
        component: whose ports they are, for messages.

    Raises:
        UserError: `ports` names a variable that the FMU does not have, a unit that there is not or that the variable
            does not have, or joins what does not belong together.
    """
    units, access = declared_units(description), ACCESS[int(description.fmiVersion[0])]
    variables = [_variable(v, units, access.get(v.type)) for v in description.modelVariables]
    whole = _with_whole_arrays({variable.name: variable for variable in variables})
    known = whole | {part.name: part for variable in whole.values() for part in _parts(variable)}
    mapped: dict[str, Variable] = {}
    used: dict[tuple[Access | None, int, int], str] = {}
    for port, wanted in ports.items():
        where = f"components.{component}.ports.{port}"
        for name in wanted.variables:
            if name not in known:
                raise UserError(f"{where} is {name!r} but must be {one_of(known, name)}")
            for place in _places(known[name]):
                if place in used:
                    raise UserError(f"{where}: {name} is in the port {used[place]} already, take one of the two out")
                used[place] = port
        mapped[port] = _mapped(port, [known[name] for name in wanted.variables], wanted, where)
    rest: dict[str, Variable] = {}
    for name, variable in whole.items():
        free = [part for part in _parts(variable) if used.keys().isdisjoint(_places(part))]
        rest |= {name: variable} if len(free) == variable.size else {part.name: part for part in free}
    return {name: _in_si(variable) for name, variable in (rest | mapped).items()}


def _places(variable: Variable) -> list[tuple[Access | None, int, int]]:
    """Where its elements are in the FMU; FMI 2 counts value references for each type anew."""
    return [(variable.access, element.reference, element.index) for element in variable.elements]


def _variable(variable: Any, units: Mapping[str, Unit | None], access: Access | None) -> Variable:
    declared = variable.declaredType
    size = math.prod(variable.shape) if variable.shape else 1
    limits = {
        bound: getattr(variable, bound) or (getattr(declared, bound) if declared else None) for bound in ("min", "max")
    }
    lowest, highest = (
        (access.lowest, access.highest) if access and variable.type != "Enumeration" else (-math.inf, math.inf)
    )
    unit = variable.unit or (declared.unit if declared else None)
    return Variable(
        name=variable.name,
        type=variable.type,
        access=access,
        causality=variable.causality,
        unit=unit or "1",
        description=variable.description or "",
        shape=size if variable.shape else None,
        elements=tuple(Element(variable.valueReference, i, size) for i in range(size)),
        start=None if access is None or variable.start is None else _start(variable.start, size),
        minimum=lowest if limits["min"] is None else float(limits["min"]),
        maximum=highest if limits["max"] is None else float(limits["max"]),
        choices={i.name: int(i.value) for i in declared.items} if declared and variable.type == "Enumeration" else {},
        measures=units.get(unit, unit_of_name(unit)) if unit else None,
    )


def _mapped(port: str, parts: Sequence[Variable], wanted: PortMap, where: str) -> Variable:
    """The port that some variables form together, with the scale and the unit that are stated for it."""
    if any((part.causality, part.type) != (parts[0].causality, parts[0].type) for part in parts):
        raise UserError(f"{where}: the variables differ in type or causality")
    if any(part.measures != parts[0].measures for part in parts):
        raise UserError(f"{where}: the variables differ in unit, {', '.join(f'{p.name} in {p.unit}' for p in parts)}")
    variable = replace(_joined(parts) if len(parts) > 1 else parts[0], name=port)
    connectable = variable.is_number and variable.causality in ("input", "output")
    for field in sorted(wanted.model_fields_set & {"unit", "scale", "offset"}):
        if not connectable:
            raise UserError(f"{where}.{field}: only inputs and outputs that are numbers are converted, leave it out")
        if field == "unit" and not variable.is_real:
            raise UserError(f"{where}.unit: {variable.type} values have no unit, leave it out")
    if wanted.unit is not None:
        measures = unit_of_name(wanted.unit)
        if measures is None:
            raise UserError(f"{where}.unit is {wanted.unit!r} but must be a unit such as m/s, deg/s or rpm")
        if variable.measures is not None and variable.measures.exponents != measures.exponents:
            raise UserError(f"{where}.unit is {wanted.unit!r} but the FMU declares {variable.unit!r}, leave it out")
        variable = replace(variable, unit=wanted.unit, measures=measures)
    scales, offsets = (
        _each(getattr(wanted, field), variable.size, f"{where}.{field}") for field in ("scale", "offset")
    )
    changes = zip(variable.elements, scales, offsets, strict=True)
    elements = [replace(element, scale=scale, offset=offset) for element, scale, offset in changes]
    return replace(variable, elements=tuple(elements))


def _each(value: float | list[float], size: int, where: str) -> list[float]:
    """A number for each element of a port."""
    numbers = value if isinstance(value, list) else [value] * size
    if len(numbers) != size:
        raise UserError(f"{where} has {len(numbers)} numbers, but the port has {size} elements")
    return numbers


def _in_si(variable: Variable) -> Variable:
    """The variable with values in SI units, if it is a real input or output whose unit is known."""
    unit = variable.measures
    if unit is None or not variable.is_real or variable.causality not in ("input", "output"):
        return variable
    if (unit.factor, unit.offset) == (1.0, 0.0):
        return variable
    elements = [
        replace(e, scale=e.scale * unit.factor, offset=e.scale * unit.offset + e.offset) for e in variable.elements
    ]
    return replace(variable, elements=tuple(elements), unit=unit.name_in_si)


def _start(start: str, size: int) -> tuple[float, ...]:
    """Start values; FMI 3 lets one value stand for all elements of an array."""
    values = tuple(float({"true": 1, "false": 0}.get(text, text)) for text in start.split())
    return values * size if len(values) == 1 else values


def _with_whole_arrays(scalars: dict[str, Variable]) -> dict[str, Variable]:
    """The variables, with name[1] ... name[n] of one type and causality joined to an array `name`."""
    groups: dict[str, list[Variable]] = {}
    for name, variable in scalars.items():
        match = _ELEMENT.fullmatch(name)
        groups.setdefault(match[1] if match else name, []).append(variable)
    variables: dict[str, Variable] = {}
    for name, parts in groups.items():
        elements = [f"{name}[{i + 1}]" for i in range(len(parts))]
        kinds = {(part.type, part.causality, part.unit) for part in parts}
        if [part.name for part in parts] == elements and len(kinds) == 1:
            variables[name] = replace(_joined(parts), name=name)
        else:
            variables |= {part.name: part for part in parts}
    return variables


def _parts(variable: Variable) -> list[Variable]:
    """The elements of an array as scalars name[1], name[2], ..., or the scalar itself."""
    if variable.shape is None:
        return [variable]
    return [
        replace(
            variable,
            name=f"{variable.name}[{i + 1}]",
            shape=None,
            elements=(element,),
            start=None if variable.start is None else variable.start[i : i + 1],
        )
        for i, element in enumerate(variable.elements)
    ]


def _joined(parts: Sequence[Variable]) -> Variable:
    starts = [part.start for part in parts]
    return replace(
        parts[0],
        shape=sum(part.size for part in parts),
        elements=tuple(element for part in parts for element in part.elements),
        start=None if None in starts else tuple(value for start in starts for value in start or ()),
        minimum=max(part.minimum for part in parts),
        maximum=min(part.maximum for part in parts),
    )
