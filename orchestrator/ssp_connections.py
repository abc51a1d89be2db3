"""Connections of an SSP archive as connections of ports: through the connectors of systems, transformed, in arrays."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.orchestrator.ssp_archive import NAMESPACES, SspArchive
from rotordx.orchestrator.ssp_elements import Fmu, Subsystem
from rotordx.orchestrator.ssp_parameters import Affine, Given, conversion, transformation
from rotordx.orchestrator.units import Unit
from rotordx.orchestrator.variables import Element

Node = tuple[tuple[str, ...], str]  #: path of an element, name of its connector

_FROM_ELEMENT = ("output", "calculatedParameter")  #: kinds of connectors that give their value to the outside


@dataclass(frozen=True)
class Link:
    """What feeds a connector."""

    source: Node
    change: Affine  #: from the value of the source to the connector's


@dataclass(frozen=True)
class Wire:
    """What feeds an input of an FMU, in the units that the FMUs themselves have."""

    source: tuple[Fmu, str]
    change: Affine


class Connectors:
    """All connectors of an archive and what joins them."""

    def __init__(
        self, archive: SspArchive, systems: Sequence[Subsystem], fmus: Sequence[Fmu], units: Mapping[str, Unit]
    ):
        """Resolve the connections.

        Raises:
            UserError: a connection is impossible or of an unsupported kind.
        """
        self._archive = archive
        self._units = units
        self._elements: dict[tuple[str, ...], Subsystem | Fmu] = {system.path: system for system in systems}
        self._elements |= {fmu.path: fmu for fmu in fmus}
        self._links: dict[Node, Link] = {}
        self._fed: dict[tuple[str, ...], list[str]] = defaultdict(list)
        for system in systems:
            for connection in system.element.findall("ssd:Connections/ssd:Connection", NAMESPACES):
                self._add(system, connection)

    def feeders(self, fmu: Fmu) -> Iterator[tuple[str, Wire | Given]]:
        """(connector, what feeds it) of an FMU: an output of another one, or a value that a system has.

        Raises:
            UserError: it is fed from outside of the archive's system, or by itself.
        """
        for connector in self._fed[fmu.path]:
            yield connector, self._feeder(fmu, connector)

    def _add(self, system: Subsystem, connection: ET.Element) -> None:
        ends = [self._end(system, connection, "start"), self._end(system, connection, "end")]
        where = f"the connection from {_shown(ends[0])} to {_shown(ends[1])}"
        gives = [self._gives(system, node, where) for node in ends]
        if gives[0] == gives[1]:
            both = "give" if gives[0] else "take"
            raise self._archive.error(f"{where} is impossible, both {both} a value")
        source, target = ends if gives[0] else ends[::-1]
        if target in self._links:
            raise self._archive.error(f"{_shown(target)} is connected twice, remove one of the two connections")
        change = transformation(self._archive, connection, where)
        if connection.get("suppressUnitConversion", "false") not in ("true", "1"):
            change = change.after(conversion(self._archive, self._unit(source), self._unit(target), where))
        self._links[target] = Link(source, change)
        self._fed[target[0]].append(target[1])

    def _end(self, system: Subsystem, connection: ET.Element, end: str) -> Node:
        element = connection.get(f"{end}Element")
        path = (*system.path, element) if element else system.path
        if path not in self._elements:
            raise self._archive.error(f"a connection names the element {'.'.join(path)}, which there is not")
        return path, connection.get(f"{end}Connector", "")

    def _gives(self, system: Subsystem, node: Node, where: str) -> bool:
        """Whether a connector gives its value to a connection of a system."""
        path, name = node
        element = self._elements[path]
        connector = element.connectors.get(name)
        kind = connector.get("kind") if connector is not None else None
        if isinstance(element, Fmu):
            variable = element.variable(name)
            kind = variable.causality if variable is not None else kind
        if kind is None:
            raise self._archive.error(f"{where}: there is no connector {_shown(node)}")
        return (kind in _FROM_ELEMENT) == (path != system.path)

    def _unit(self, node: Node) -> Unit | None:
        """The unit of a connector: that of the FMU's variable, else the one that the archive states."""
        path, name = node
        element = self._elements[path]
        variable = element.variable(name) if isinstance(element, Fmu) else None
        if variable is not None and variable.measures is not None:
            return variable.measures
        connector = element.connectors.get(name)
        real = connector.find("ssc:Real", NAMESPACES) if connector is not None else None
        return self._units.get(real.get("unit", "")) if real is not None else None

    def _feeder(self, fmu: Fmu, connector: str) -> Wire | Given:
        node, change, passed = (fmu.path, connector), Affine(), set[Node]()
        while node in self._links:
            if node in passed:
                raise self._archive.error(f"{_shown(node)} feeds itself through the connectors of systems")
            passed.add(node)
            link = self._links[node]
            node, change = link.source, change.after(link.change)
        source = self._elements[node[0]]
        if isinstance(source, Fmu):
            return Wire((source, node[1]), change)
        given = self._value(node)
        if given is None:
            raise self._archive.error(
                f"{_shown(node)} feeds {_shown((fmu.path, connector))}, but nothing is outside here: connect it, or "
                "leave its connection out"
            )
        converted = conversion(self._archive, given.unit, self._unit(node), f"the value of {_shown(node)}")
        return Given(given.text, None, change.after(given.transformation).after(converted))

    def _value(self, node: Node) -> Given | None:
        """The value that bindings give to the connector of a system; those of the outer systems count most."""
        path, name = node
        for depth in range(len(path) + 1):
            outer = self._elements[path[:depth]]
            key = ".".join([*path[depth:], name])
            if key in outer.values:
                return outer.values[key]
        return None


def connected(
    fmu: Fmu, wires: Mapping[str, Wire], order: Mapping[str, int]
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Connections to an FMU as a scenario has them, and those of its ports that are scaled or taken apart.

    Args:
        fmu: the FMU.
        wires: connector -> what feeds it.
        order: places of FMUs by name; what a later one puts out is read one step later.
    """
    connections: list[dict[str, Any]] = []
    ports: dict[str, Any] = {}
    for port, target, source, connectors in _joined(fmu, wires):
        writer = wires[connectors[0]].source[0].name
        later = order[writer] > order[fmu.name]
        connections.append({"from": f"{writer}.{source}", "to": f"{fmu.name}.{target}", "previous_step": later})
        maps = [_port_map(fmu.element(c), wires[c]) for c in connectors]
        if any(change != Affine() for change in maps):
            scale, offset = [change.factor for change in maps], [change.offset for change in maps]
            ports[target] = {"variables": target, "scale": scale, "offset": offset}
        elif target != port:
            ports[target] = target
    return connections, ports


def _joined(fmu: Fmu, wires: Mapping[str, Wire]) -> Iterator[tuple[str, str, str, list[str]]]:
    """(port, port or element of it, source port or element, connectors) of the connections to make.

    Arrays are connected element by element in SSP; those whose elements come in order from one array are joined.
    """
    by_port: dict[str, dict[int, str]] = defaultdict(dict)
    for connector in wires:
        port, index = fmu.place(connector)
        by_port[port][index] = connector
    for port, parts in by_port.items():
        size = fmu.variables[port].size if port in fmu.variables else 1
        sources = {index: wires[connector].source for index, connector in parts.items()}
        places = {index: (source.name, *source.place(connector)) for index, (source, connector) in sources.items()}
        whole = {place[:2] for place in places.values()}
        first, _ = sources[min(sources)]
        if len(whole) == 1 and {i: place[2] for i, place in places.items()} == {i: i for i in range(1, size + 1)}:
            [(_, source_port)] = whole
            if first.variables[source_port].size == size:
                yield port, port, source_port, [parts[index] for index in sorted(parts)]
                continue
        for index, connector in parts.items():
            yield port, f"{port}[{index}]" if index else port, sources[index][1], [connector]


def _port_map(element: Element | None, wire: Wire) -> Affine:
    """From the FMU's value in SI units to the port's, so that the port has the value that the output's port has.

    It is the identity where the connection does just what the units of both say. An unknown variable is left to the
    wiring to refuse.
    """
    start = wire.source[0].element(wire.source[1])
    if element is None or start is None:
        return Affine()
    natural = Affine(start.scale / element.scale, (start.offset - element.offset) / element.scale)
    same_offset = math.isclose(wire.change.offset, natural.offset, rel_tol=1e-12, abs_tol=1e-12)
    if same_offset and math.isclose(wire.change.factor, natural.factor, rel_tol=1e-12):
        return Affine()
    scale = start.scale / wire.change.factor
    factor = scale / element.scale
    return Affine(factor, start.offset - scale * wire.change.offset - factor * element.offset)


def _shown(node: Node) -> str:
    return ".".join([*node[0], node[1]])
