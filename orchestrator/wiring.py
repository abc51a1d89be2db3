"""Connections between components: checked by name, then turned into an order of computation and places on a bus."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import NoReturn, Protocol

from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.layout import Connection
from rotordx.orchestrator.recording import SignalInfo
from rotordx.orchestrator.variables import Variable

#: Pseudo-component whose outputs are given by whoever runs the system: a callback, or a recorded flight.
EXTERNAL = "external"

_SOURCE = re.compile(r"(\w+)\.(.+?)(?:\[(\d+)\])?")


class Terminals(Protocol):
    """What wiring needs to know of a component."""

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All there is, also what cannot be connected."""

    @property
    def inputs(self) -> Mapping[str, Variable]:
        """Inputs by port name."""

    @property
    def outputs(self) -> Mapping[str, Variable]:
        """Outputs by port name."""


@dataclass(frozen=True)
class Wiring:
    """The bus, one row of all signals: the external ones, then the outputs of each component as declared."""

    order: list[str]  #: components in the order of computation
    signals: list[SignalInfo]  #: in the order of their columns on the bus
    columns: dict[str, slice]  #: "component.port" -> its columns on the bus
    inputs: dict[str, list[int]]  #: component -> the column of each of its input values, in the order of its ports

    @property
    def width(self) -> int:
        """Number of columns."""
        return sum(info.width for info in self.signals)

    @property
    def external(self) -> list[SignalInfo]:
        """The external signals, the first ones on the bus."""
        return [info for info in self.signals if info.key.startswith(f"{EXTERNAL}.")]


def wire(components: Mapping[str, Terminals], connections: Iterable[Connection]) -> Wiring:
    """Resolve the connections of a system.

    Raises:
        UserError: a connection names what does not exist or does not fit, an input is not connected or connected
            twice, or the components depend on each other in a circle.
    """
    by_target = _by_target(components, list(connections))
    signals = _external_signals(components, by_target)
    for name, component in components.items():
        signals += [SignalInfo(f"{name}.{p}", v.unit, v.description, v.shape) for p, v in component.outputs.items()]
    columns, width = {}, 0
    for info in signals:
        columns[info.key] = slice(width, width + info.width)
        width += info.width
    inputs = {
        name: [
            column
            for port, variable in component.inputs.items()
            for column in _source_columns(by_target[f"{name}.{port}"], variable, columns, components)
        ]
        for name, component in components.items()
    }
    return Wiring(_order(components, by_target.values()), signals, columns, inputs)


def _by_target(components: Mapping[str, Terminals], connections: list[Connection]) -> dict[str, Connection]:
    """Connections by the input they feed; exactly one for each input there is."""
    targets = {f"{name}.{port}" for name, component in components.items() for port in component.inputs}
    by_target: dict[str, Connection] = {}
    for connection in connections:
        if connection.target not in targets:
            raise UserError(_unknown("to", connection.target, components))
        if connection.target in by_target:
            raise UserError(
                f"connection to {connection.target!r}: this input is connected twice, remove one of the two"
            )
        by_target[connection.target] = connection
    for name, component in components.items():
        for port in component.inputs:
            if f"{name}.{port}" not in by_target:
                raise UserError(
                    f"the input {name}.{port} is not connected: add a table [[connections]] with "
                    f'from = "component.output" and to = "{name}.{port}"'
                )
    return by_target


def _external_signals(components: Mapping[str, Terminals], by_target: Mapping[str, Connection]) -> list[SignalInfo]:
    """The signals that connections take from outside, shaped like the first input that they feed."""
    signals: dict[str, SignalInfo] = {}
    for name, component in components.items():
        for port, variable in component.inputs.items():
            source = by_target[f"{name}.{port}"].source
            if source.startswith(f"{EXTERNAL}.") and source not in signals:
                signals[source] = SignalInfo(source, variable.unit, variable.description, variable.shape)
    return list(signals.values())


def _source_columns(
    connection: Connection, target: Variable, columns: Mapping[str, slice], components: Mapping[str, Terminals]
) -> range:
    """Columns on the bus that feed an input."""
    found = columns.get(connection.source)
    if found is None:
        match = _SOURCE.fullmatch(connection.source)
        whole = columns.get(f"{match[1]}.{match[2]}") if match and match[3] else None
        if match is None or whole is None or not 1 <= int(match[3]) <= whole.stop - whole.start:
            raise UserError(_unknown("from", connection.source, components))
        first = whole.start + int(match[3]) - 1
        found = slice(first, first + 1)
    if found.stop - found.start != target.size:
        raise UserError(
            f"connection from {connection.source!r} to {connection.target!r}: the output has "
            f"{found.stop - found.start} elements and the input {target.size}"
        )
    _check_units(connection, target, components)
    return range(found.start, found.stop)


def _check_units(connection: Connection, target: Variable, components: Mapping[str, Terminals]) -> None:
    """Refuse a connection between units that measure different things; what has no known unit fits everything."""
    writer, _, port = connection.source.partition(".")
    outputs = components[writer].outputs if writer in components else {}
    source = outputs.get(port) or outputs.get(port.rpartition("[")[0])
    if source is None or source.measures is None or target.measures is None:
        return
    if source.measures.exponents != target.measures.exponents:
        reader, _, input_port = connection.target.partition(".")
        raise UserError(
            f"connection from {connection.source!r} to {connection.target!r}: the units do not fit, the output is in "
            f"{source.unit} and the input in {target.unit}; connect something else, or state the right unit with "
            f"components.{writer}.ports.{port} or components.{reader}.ports.{input_port}"
        )


def _unknown(end: str, name: str, components: Mapping[str, Terminals]) -> str:
    """What is wrong with a name at one end, "from" or "to", of a connection."""
    component, _, port = name.partition(".")
    if component in components and port in components[component].variables:
        variable = components[component].variables[port]
        if not variable.is_number:
            return f"connection {end} {name!r}: this is a {variable.type}, only numbers are connected"
    if component in components:
        ports = components[component].outputs if end == "from" else components[component].inputs
        known, given = [f"{component}.{port}" for port in ports], name
    else:
        known, given = list(components), component
    kind = {"from": "output", "to": "input"}[end]
    return f"connection {end} {name!r}: there is no such {kind}, it must be {one_of(known, given)}"


def _order(components: Mapping[str, Terminals], connections: Iterable[Connection]) -> list[str]:
    """Components so that a writer comes before its reader, or after it where the previous step's value is read.

    Where the connections leave a choice, the order of declaration counts.
    """
    before: dict[str, dict[str, Connection]] = {name: {} for name in components}
    for connection in connections:
        writer, reader = (end.partition(".")[0] for end in (connection.source, connection.target))
        if writer == EXTERNAL or (writer == reader and connection.previous_step):
            continue
        first, second = (reader, writer) if connection.previous_step else (writer, reader)
        before[second].setdefault(first, connection)
    sorter = TopologicalSorter({name: list(first) for name, first in before.items()})
    try:
        sorter.prepare()
    except CycleError as error:
        _refuse_loop(error.args[1], before)
    declared = list(components)
    order: list[str] = []
    ready: list[str] = []
    while sorter.is_active():
        ready = sorted([*ready, *sorter.get_ready()], key=declared.index)
        order.append(ready.pop(0))
        sorter.done(order[-1])
    return order


def _refuse_loop(cycle: list[str], before: Mapping[str, Mapping[str, Connection]]) -> NoReturn:
    """Name the connections of a circle, from each component to the next one that must come after it."""
    links = [before[second][first] for first, second in pairwise(cycle)]
    named = ", ".join(
        f"{link.source} -> {link.target}{' (previous step)' if link.previous_step else ''}" for link in links
    )
    raise UserError(
        f"the components depend on each other in a circle: {named}; set previous_step = true for the one that may "
        "read the value from the end of the previous step"
    )
