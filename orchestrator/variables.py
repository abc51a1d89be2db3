"""Variables of an FMU as ports: arrays whole and values in SI units, however the FMU has them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.layout import PortMap
from rotordx.orchestrator.units import Unit, declared_units, unit_of_name

REAL_TYPES = ("Real", "Float64")
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
    def is_real(self) -> bool:
        """Whether it can be connected and logged."""
        return self.type in REAL_TYPES


@dataclass(frozen=True)
class Exchange:
    """How the values of some ports lie in one call that sets or gets them all."""

    references: tuple[int, ...]
    size: int  #: number of values of the call
    places: tuple[int, ...]  #: of each value of the ports among those of the call
    scale: tuple[float, ...]  #: value of the port = scale * value of the call + offset
    offset: tuple[float, ...]

    @classmethod
    def of(cls, variables: Iterable[Variable]) -> Exchange:
        """The call for these ports."""
        elements = [element for variable in variables for element in variable.elements]
        first, size = {}, 0
        for element in elements:
            if element.reference not in first:
                first[element.reference] = size
                size += element.count
        return cls(
            references=tuple(first),
            size=size,
            places=tuple(first[element.reference] + element.index for element in elements),
            scale=tuple(element.scale for element in elements),
            offset=tuple(element.offset for element in elements),
        )

    @property
    def plain(self) -> bool:
        """Whether the call's values are the ports' as they are."""
        return self.places == tuple(range(self.size)) and set(self.scale) <= {1.0} and not any(self.offset)

    @property
    def inverse(self) -> tuple[list[float], list[float]]:
        """(scale, offset) the other way round: value of the call = scale * value of the port + offset."""
        return [1 / s for s in self.scale], [-o / s for s, o in zip(self.scale, self.offset, strict=True)]

    def to_call(self, values: Sequence[float]) -> list[float]:
        """Values of the call from those of the ports."""
        call = [0.0] * self.size
        for value, place, scale, offset in zip(values, self.places, *self.inverse, strict=True):
            call[place] = scale * value + offset
        return call

    def from_call(self, call: Sequence[float]) -> list[float]:
        """Values of the ports from those of the call."""
        return [s * call[place] + o for place, s, o in zip(self.places, self.scale, self.offset, strict=True)]


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
    units = declared_units(description)
    whole = _with_whole_arrays({v.name: _variable(v, units) for v in description.modelVariables})
    known = whole | {part.name: part for variable in whole.values() for part in _parts(variable)}
    mapped: dict[str, Variable] = {}
    used: dict[tuple[int, int], str] = {}
    for port, wanted in ports.items():
        where = f"components.{component}.ports.{port}"
        for name in wanted.variables:
            if name not in known:
                raise UserError(f"{where} is {name!r} but must be {one_of(known, name)}")
            for element in known[name].elements:
                place = (element.reference, element.index)
                if place in used:
                    raise UserError(f"{where}: {name} is in the port {used[place]} already, take one of the two out")
                used[place] = port
        mapped[port] = _mapped(port, [known[name] for name in wanted.variables], wanted, where)
    rest: dict[str, Variable] = {}
    for name, variable in whole.items():
        free = [part for part in _parts(variable) if (part.elements[0].reference, part.elements[0].index) not in used]
        rest |= {name: variable} if len(free) == variable.size else {part.name: part for part in free}
    return {name: _in_si(variable) for name, variable in (rest | mapped).items()}


def _variable(variable: Any, units: Mapping[str, Unit | None]) -> Variable:
    declared = variable.declaredType
    size = math.prod(variable.shape) if variable.shape else 1
    limits = {
        bound: getattr(variable, bound) or (getattr(declared, bound) if declared else None) for bound in ("min", "max")
    }
    unit = variable.unit or (declared.unit if declared else None)
    return Variable(
        name=variable.name,
        type=variable.type,
        causality=variable.causality,
        unit=unit or "1",
        description=variable.description or "",
        shape=size if variable.shape else None,
        elements=tuple(Element(variable.valueReference, i, size) for i in range(size)),
        start=_start(variable, size),
        minimum=-math.inf if limits["min"] is None else float(limits["min"]),
        maximum=math.inf if limits["max"] is None else float(limits["max"]),
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
    stated = wanted.model_fields_set & {"unit", "scale"}
    if stated and not (variable.is_real and variable.causality in ("input", "output")):
        raise UserError(f"{where}.{min(stated)}: only real inputs and outputs are converted, leave it out")
    if wanted.unit is not None:
        measures = unit_of_name(wanted.unit)
        if measures is None:
            raise UserError(f"{where}.unit is {wanted.unit!r} but must be a unit such as m/s, deg/s or rpm")
        if variable.measures is not None and variable.measures.exponents != measures.exponents:
            raise UserError(f"{where}.unit is {wanted.unit!r} but the FMU declares {variable.unit!r}, leave it out")
        variable = replace(variable, unit=wanted.unit, measures=measures)
    scales = wanted.scale if isinstance(wanted.scale, list) else [wanted.scale] * variable.size
    if len(scales) != variable.size:
        raise UserError(f"{where}.scale has {len(scales)} numbers, but the port has {variable.size} elements")
    elements = [replace(element, scale=scale) for element, scale in zip(variable.elements, scales, strict=True)]
    return replace(variable, elements=tuple(elements))


def _in_si(variable: Variable) -> Variable:
    """The variable with values in SI units, if it is a real input or output whose unit is known."""
    unit = variable.measures
    if unit is None or not variable.is_real or variable.causality not in ("input", "output"):
        return variable
    if (unit.factor, unit.offset) == (1.0, 0.0):
        return variable
    elements = [replace(e, scale=e.scale * unit.factor, offset=e.scale * unit.offset) for e in variable.elements]
    return replace(variable, elements=tuple(elements), unit=unit.name_in_si)


def _start(variable: Any, size: int) -> tuple[float, ...] | None:
    """Start values; FMI 3 lets one value stand for all elements of an array."""
    if variable.start is None or variable.type in ("String", "Binary", "Clock"):
        return None
    values = tuple(float({"true": 1, "false": 0}.get(text, text)) for text in variable.start.split())
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
