"""Elements of an SSP archive: the FMUs of its system and of the systems within, and the systems themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from rotordx.orchestrator.archive import open_archive
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.ssp_archive import NAMESPACES, SspArchive, tag
from rotordx.orchestrator.ssp_parameters import Given, bound
from rotordx.orchestrator.variables import Element, Variable, read_variables

DEEPEST = 20  #: levels of systems within systems
_FMU = "application/x-fmu-sharedlibrary"
_ELEMENT = re.compile(r"(.+)\[(\d{1,9})\]")


@dataclass(frozen=True)
class Subsystem:
    """A system: the archive's, whose path is empty, or one within it."""

    path: tuple[str, ...]  #: names of the systems that it is in, without the archive's, and its own
    element: ET.Element
    connectors: Mapping[str, ET.Element]  #: its own, by name
    values: Mapping[str, Given]  #: of its parameter bindings, by the names of parameters within it


@dataclass(frozen=True)
class Fmu:
    """A component of a system."""

    path: tuple[str, ...]
    name: str  #: here: its path, with underscores
    file: Path
    description: Any  #: fmpy.model_description.ModelDescription
    connectors: Mapping[str, ET.Element]
    values: Mapping[str, Given]
    variables: Mapping[str, Variable]  #: by port

    def place(self, connector: str) -> tuple[str, int]:
        """Port and index (from 1; 0: the port as a whole) of a connector; an unknown one is a port of that name."""
        match = _ELEMENT.fullmatch(connector)
        if connector not in self.variables and match and match[1] in self.variables:
            index = int(match[2])
            if 0 < index <= self.variables[match[1]].size:
                return match[1], index
        return connector, 0

    def variable(self, connector: str) -> Variable | None:
        """The variable that a connector belongs to; None: there is none."""
        return self.variables.get(self.place(connector)[0])

    def element(self, connector: str) -> Element | None:
        """The value of the FMU behind a connector; None: there is none, or several."""
        port, index = self.place(connector)
        variable = self.variables.get(port)
        if variable is None or (index == 0 and variable.size > 1):
            return None
        return variable.elements[max(index, 1) - 1]


def elements(archive: SspArchive, system: ET.Element, path: tuple[str, ...] = ()) -> Iterator[Subsystem | Fmu]:
    """A system, what is in it in the order of declaration, and what is in the systems in it.

    Raises:
        UserError: an element is of a kind that cannot be flown, or its FMU cannot be used.
    """
    if len(path) > DEEPEST:
        raise archive.error(f"{'.'.join(path)} is more than {DEEPEST} systems deep")
    yield Subsystem(path, system, _connectors(system), bound(archive, system))
    seen = set[str]()
    for element in system.findall("ssd:Elements/*", NAMESPACES):
        name = element.get("name", "")
        own = (*path, name)
        if not name or name in seen:
            raise archive.error(f"two elements of one system are named {name!r}, each needs a name of its own")
        seen.add(name)
        if element.tag == tag("ssd:System"):
            yield from elements(archive, element, own)
        else:
            yield _fmu(archive, element, own)


def _fmu(archive: SspArchive, element: ET.Element, path: tuple[str, ...]) -> Fmu:
    name = ".".join(path)
    _, _, kind = element.tag.rpartition("}")
    if kind != "Component" or element.get("type", _FMU) != _FMU:
        what = f"a component of the type {element.get('type')}" if kind == "Component" else f"a {kind}"
        raise archive.error(
            f"{name} is {what}, which is not supported: supported are FMUs, and systems within the same document"
        )
    if element.get("implementation") == "ModelExchange":
        raise archive.error(f"{name} is to be used for model exchange, supported is co-simulation")
    file = archive.file(element.get("source", ""))
    if file is None:
        raise archive.error(f"the source {element.get('source', '')!r} of {name} is not in the archive")
    try:
        description = open_archive(file).description
    except UserError as error:
        raise archive.error(str(error).replace(str(file), element.get("source", ""))) from error
    flat = re.sub(r"\W", "_", "_".join(path))
    variables = read_variables(description, {}, flat)
    return Fmu(path, flat, file, description, _connectors(element), bound(archive, element), variables)


def _connectors(element: ET.Element) -> dict[str, ET.Element]:
    found = element.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
    return {connector.get("name", ""): connector for connector in found}
