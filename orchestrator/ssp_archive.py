"""Documents and FMUs in an archive of System Structure and Parameterization, refused if they are hostile."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree as ET

from rotordx.orchestrator.archive import extract
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.units import BASE_UNITS, Unit

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
# Types of annotations. SSP has no element for the step size; these two hold it.
OSP = "com.opensimulationplatform"
OPENMODELICA = "org.openmodelica"
ROTORDX = "org.rotordx"  #: holds the vehicle's name

LARGEST_DOCUMENT = 2**24  #: bytes of an XML document, which is read as a whole


def tag(name: str) -> str:
    """The tag of an element, "ssd:System" for example."""
    prefix, _, local = name.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{local}"


class SspArchive:
    """An extracted archive; it is removed when the process ends."""

    def __init__(self, path: Path):
        """Check and extract it.

        Raises:
            UserError: it is no archive, or its content is hostile.
        """
        self.path = path
        self._folder = extract(path, "an SSP archive").resolve()

    def error(self, sentence: str) -> UserError:
        """What to raise if the archive cannot be flown."""
        return UserError(f"{self.path}: {sentence}")

    def file(self, source: str) -> Path | None:
        """A file by its URI, which is relative to the system structure; None if the archive has no such file."""
        for name in (source, unquote(source)):
            path = (self._folder / name).resolve()
            with suppress(OSError, ValueError):  # a name that is too long, for example
                if path.is_relative_to(self._folder) and path.is_file():
                    return path
        return None

    def document(self, source: str, root: str) -> ET.Element:
        """The root of an XML document of SSP 1.0.

        Args:
            source: URI of the document.
            root: its tag, "ssd:SystemStructureDescription" for example.

        Raises:
            UserError: there is no such document, or it is none of this kind, hostile or too large.
        """
        path = self.file(source)
        if path is None:
            raise self.error(f"{source!r} cannot be read, it is not in the archive")
        size = path.stat().st_size
        if size > LARGEST_DOCUMENT:
            raise self.error(f"{source!r} has {size / 2**20:.0f} MiB, more than such a document has")
        try:
            document = ET.parse(path, ET.XMLParser(target=_Builder())).getroot()
        except (ET.ParseError, LookupError, ValueError) as error:
            raise self.error(f"{source!r} cannot be read: {error}") from error
        self.check(document, root, source)
        return document

    def check(self, element: ET.Element, expected: str, where: str) -> None:
        """Raise a UserError unless an element is the one that is expected, of SSP 1."""
        version = element.get("version", "")
        if element.tag != tag(expected) or not version.startswith("1."):
            _, _, name = element.tag.rpartition("}")
            told = f"{name} of version {version}" if version else name
            raise self.error(f"{where!r} is {told}, but must be {expected} of SSP 1.0: export it as that")

    def units(self, element: ET.Element | None) -> dict[str, Unit]:
        """The units that a document defines (ssd:Units or ssv:Units), by name."""
        units: dict[str, Unit] = {}
        for unit in element if element is not None else ():
            base = unit.find("ssc:BaseUnit", NAMESPACES)
            if base is None:
                continue
            try:
                exponents = {name: int(base.get(name, "0")) for name in BASE_UNITS if int(base.get(name, "0"))}
                definition = Unit(exponents, float(base.get("factor", "1")), float(base.get("offset", "0")))
            except ValueError as error:
                raise self.error(f"the unit {unit.get('name')!r} cannot be read: {error}") from error
            if definition.factor == 0:
                raise self.error(f"the unit {unit.get('name')!r} has the factor 0")
            units[unit.get("name", "")] = definition
        return units


class _Builder(ET.TreeBuilder):
    """Builds a document that has no DOCTYPE, whose entities could fill the memory or name files of this machine."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise ValueError("it has a DOCTYPE, which SSP does not use: remove it")
