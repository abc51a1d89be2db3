"""Variables of an FMU as ports: arrays whole, whether FMI 3 declares them or FMI 2 spells out their elements."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError

REAL_TYPES = ("Real", "Float64")
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")


@dataclass(frozen=True)
class Variable:
    """A scalar (`shape` is None) or an array of `shape` elements."""

    name: str
    type: str  #: of FMI: "Real", "Float64", "Enumeration", ...
    causality: str
    unit: str
    description: str
    shape: int | None
    references: tuple[int, ...]  #: one value reference for the whole, or in FMI 2 one for each element
    start: tuple[float, ...] | None  #: numbers only
    minimum: float
    maximum: float
    choices: Mapping[str, int]  #: names and values of an enumeration

    @property
    def size(self) -> int:
        """Number of elements."""
        return 1 if self.shape is None else self.shape

    @property
    def is_real(self) -> bool:
        """Whether it can be connected and logged."""
        return self.type in REAL_TYPES


def read_variables(description: Any, ports: Mapping[str, Sequence[str]], component: str) -> dict[str, Variable]:
    """Variables of a model description by port name.

    Args:
        description: fmpy.model_description.ModelDescription.
        ports: port name -> the FMU's own name, or scalar variables that together form an array port.
        component: whose ports they are, for messages.

    Raises:
        UserError: `ports` names a variable that the FMU does not have, or joins what does not belong together.
    """
    scalars = {v.name: _variable(v) for v in description.modelVariables}
    variables = _with_whole_arrays(scalars)
    for port, names in ports.items():
        known = scalars | variables
        for name in names:
            if name not in known:
                raise UserError(f"components.{component}.ports.{port} is {name!r} but must be {one_of(known, name)}")
        parts = [known[name] for name in names]
        if any(part.causality != parts[0].causality or part.type != parts[0].type for part in parts):
            raise UserError(f"components.{component}.ports.{port}: the variables differ in type or causality")
        for name in names:
            variables.pop(name, None)
        variables[port] = replace(_joined(parts), name=port) if len(parts) > 1 else replace(parts[0], name=port)
    return variables


def _variable(variable: Any) -> Variable:
    declared = variable.declaredType
    size = math.prod(variable.shape) if variable.shape else 1
    limits = {
        bound: getattr(variable, bound) or (getattr(declared, bound) if declared else None) for bound in ("min", "max")
    }
    return Variable(
        name=variable.name,
        type=variable.type,
        causality=variable.causality,
        unit=variable.unit or (declared.unit if declared else None) or "1",
        description=variable.description or "",
        shape=size if variable.shape else None,
        references=(variable.valueReference,),
        start=_start(variable, size),
        minimum=-math.inf if limits["min"] is None else float(limits["min"]),
        maximum=math.inf if limits["max"] is None else float(limits["max"]),
        choices={i.name: int(i.value) for i in declared.items} if declared and variable.type == "Enumeration" else {},
    )


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
        if [part.name for part in parts] == elements and len({(part.type, part.causality) for part in parts}) == 1:
            variables[name] = replace(_joined(parts), name=name)
        else:
            variables |= {part.name: part for part in parts}
    return variables


def _joined(parts: Sequence[Variable]) -> Variable:
    starts = [part.start for part in parts]
    return replace(
        parts[0],
        shape=sum(part.size for part in parts),
        references=tuple(reference for part in parts for reference in part.references),
        start=None if None in starts else tuple(value for start in starts for value in start or ()),
        minimum=max(part.minimum for part in parts),
        maximum=min(part.maximum for part in parts),
    )
