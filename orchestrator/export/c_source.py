"""The C of a diagnoser: structs with named fields around the very source that its FMU is built from.

Every struct consists of numbers of one type in port order, so that the generated functions can take it for the array
that they expect: nothing is copied, and the compiler checks that the sizes agree.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import re
import textwrap
from collections.abc import Iterable, Sequence

import numpy as np

from rotordx.fmus.diagnosers.codegen import step_source
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.shell.ports import STEP_SIZE, Port, size, table
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.orchestrator.export.subject import Subject
from rotordx.orchestrator.export.templates import filled

COLUMNS, COMMENT_COLUMN = 120, 40
_STEP_SIZE = dataclasses.replace(STEP_SIZE, description="time between two samples")


def header(subject: Subject) -> str:
    """Contents of `rotordx_<id>.h`."""
    gains = subject.component.parameters[-1]
    names = {"id": subject.diagnoser, "ID": subject.diagnoser.upper(), "parameters": constant_name(subject)}
    return filled(
        "rotordx.h.in",
        **names,
        description=subject.component.description,
        input_fields=_fields(table(Inputs)),
        vehicle_fields=_fields(table(VehicleParameters)),
        gains=_gains(subject.diagnoser, table(gains)),
        gains_field=f"  rotordx_{subject.diagnoser}_gains gains;\n" if table(gains) else "",
        step_size_field=_fields([_STEP_SIZE]),
        state_fields=_fields(table(subject.state)),
        output_fields=_fields(table(subject.component.outputs)),
        vehicle=subject.vehicle.name,
    )


def source(subject: Subject) -> str:
    """Contents of `rotordx_<id>.c`."""
    diagnoser, gains = subject.diagnoser, subject.component.parameters[-1]
    return filled(
        "rotordx.c.in",
        id=diagnoser,
        parameters=constant_name(subject),
        generated=generated_source(diagnoser),
        inputs=size(Inputs),
        states=subject.state_numbers,
        outputs=size(subject.component.outputs),
        parameter_count=STEP_SIZE.size + size(VehicleParameters) + size(gains),
        limits=_limits([STEP_SIZE, *table(VehicleParameters), *table(gains)]),
        step_size=_number(subject.step_size),
        vehicle=subject.vehicle.name,
        vehicle_values=_values("vehicle", table(subject.component.parameters[0])),
        gain_values=_values("gains", table(gains)),
    )


def generated_source(diagnoser: str) -> str:
    """The C files that the FMU's step is compiled from, one after the other."""
    return "\n".join(text for name, text in sorted(step_source(diagnoser).items()) if name.endswith(".c"))


def source_hash(diagnoser: str) -> str:
    """SHA-256 of these files: what was measured of them holds for every vehicle."""
    return hashlib.sha256(generated_source(diagnoser).encode()).hexdigest()


def constant_name(subject: Subject) -> str:
    """Name of the const struct with the parameters of the vehicle."""
    vehicle = re.sub(r"\W", "_", subject.vehicle.name)
    return f"rotordx_{subject.diagnoser}_{vehicle}"


def numbers(values: Iterable[np.floating], indent: int) -> str:
    """C literals of type double, or float if that is what the values are, filled into lines after the first."""
    text = ", ".join(map(_number, values))
    return textwrap.fill(text, COLUMNS, initial_indent=" " * indent, subsequent_indent=" " * indent)[indent:]


def _number(value: float | np.floating) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"{value!s}F" if isinstance(value, np.float32) else repr(float(value))


def _fields(ports: Sequence[Port]) -> str:
    """Declarations of a struct, each with its unit and meaning."""
    lines = []
    for p in ports:
        declaration = f"  rotordx_real {p.name}{'' if p.shape is None else f'[{p.shape}]'};"
        choices = "; ".join(f"{i} {choice}" for i, choice in enumerate(p.choices))
        comment = f"// [{p.unit}] {p.description}{choices and ': '}{choices}"
        line = f"{declaration:{COMMENT_COLUMN}}  {comment}"
        lines += [line] if len(line) <= COLUMNS else [*_wrapped(comment), declaration]
    return "".join(f"{line}\n" for line in lines)


def _wrapped(comment: str) -> list[str]:
    return textwrap.wrap(comment, COLUMNS, initial_indent="  ", subsequent_indent="  // ")


def _gains(diagnoser: str, ports: Sequence[Port]) -> str:
    """Type of the diagnoser's own parameters, none if it has none."""
    if not ports:
        return ""
    doc = "// Gains and bounds; designed for one vehicle, see manifest.json."
    return f"{doc}\ntypedef struct rotordx_{diagnoser}_gains {{\n{_fields(ports)}}} rotordx_{diagnoser}_gains;\n\n"


def _limits(ports: Sequence[Port]) -> str:
    """Rows of the table of ranges: offset of the first element, number of elements, smallest and largest value."""
    rows, offset = [], 0
    for p in ports:
        minimum, maximum = (0, len(p.choices) - 1) if p.choices else (p.minimum, p.maximum)
        low = "-MAX" if minimum is None else _real(minimum)
        high = "MAX" if maximum is None else _real(maximum)
        rows.append(f"      {{{offset}, {p.size}, {low}, {high}}},  // {p.name}\n")
        offset += p.size
    return "".join(rows)


def _values(field: str, ports: Sequence[Port]) -> str:
    """Initialisers of a struct."""
    if not ports:
        return ""
    lines = []
    for p in ports:
        elements = [_real(v) for v in p.start]
        line = f"            .{p.name} = {elements[0] if p.shape is None else '{' + ', '.join(elements) + '}'},"
        lines += textwrap.wrap(line, COLUMNS, subsequent_indent=" " * 16, break_long_words=False)
    return f"    .{field} =\n        {{\n" + "\n".join(lines) + "\n        },\n"


def _real(value: float) -> str:
    return f"ROTORDX_REAL({_number(value)})"
