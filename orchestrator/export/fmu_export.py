"""The archive that `rotordx export fmu` writes: an FMU whose start values are those of a vehicle and its design."""

from __future__ import annotations

import dataclasses
import html
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from importlib.metadata import distribution, version
from pathlib import Path
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import fmpy
import numpy as np
from markdown_it import MarkdownIt

from rotordx.fmus import component_names, diagnoser_ids, fmu_path, load_component
from rotordx.fmus.shell.generate import generate
from rotordx.fmus.shell.model_description import token
from rotordx.fmus.shell.pack import pack
from rotordx.fmus.shell.ports import Component, with_starts
from rotordx.fmus.shell.readme import CLOSING, OPENING, port_table, readme_path
from rotordx.fmus.vehicles import Vehicle
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export.fmu_compiler import DEFINITIONS, OPTIONS, Platform, library
from rotordx.orchestrator.export.fmu_sources import compiled, sources
from rotordx.orchestrator.export.subject import vehicle_and_design

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{name}</title>
<style>
body {{ font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; }}
table {{ border-collapse: collapse; }}
td, th {{ border: 1px solid #bbb; padding: 0.2em 0.6em; text-align: left; }}
pre, code {{ background: #f3f3f3; }}
</style>
</head>
<body>
{body}
</body>
</html>
"""

_ICON = """<?xml version="1.0" encoding="UTF-8"?>
<fmiTerminalsAndIcons fmiVersion="3.0">
  <GraphicalRepresentation>
    <CoordinateSystem x1="-100" y1="-100" x2="100" y2="100" suggestedScalingFactorTo_mm="0.1"/>
    <Icon x1="-100" y1="-100" x2="100" y2="100"/>
  </GraphicalRepresentation>
</fmiTerminalsAndIcons>
"""


def parametrised(name: str, vehicle: str) -> tuple[Component, Vehicle]:
    """A component whose parameters start at what a vehicle and, for a diagnoser, its design say.

    Raises:
        UserError: there is no such component or vehicle, or the diagnoser has no design for it.
    """
    known = [*component_names(), *diagnoser_ids()]
    if name not in known:
        raise UserError(f"{name!r} must be {one_of(known, name)}")
    craft, design = vehicle_and_design(name, vehicle)
    starts = craft.parameters | (design["parameters"] if design else {})
    component = load_component(name)
    parameters = tuple(with_starts(cls, starts) for cls in component.parameters)
    return dataclasses.replace(component, parameters=parameters), craft


def contents(
    component: Component,
    vehicle: Vehicle,
    fmi: int,
    platforms: Sequence[Platform],
    with_sources: bool,
    report: Callable[[str], None],
) -> dict[str, bytes]:
    """Files of an FMU: name in the archive -> contents.

    Raises:
        UserError: a platform cannot be compiled for.
        RunError: the compiler failed.
    """
    written = {f"binaries/{p.folder(fmi)}/{component.name}{p.suffix}": b"" for p in platforms}
    code: dict[str, bytes] = {}
    for name, target in zip(written, platforms, strict=True):
        built = _as_packaged(component, fmi, name)
        if built is None:
            code = code or sources(component, fmi)
            built = library(component.name, code, target, report)
        written[name] = built
    description = generate(component, version("rotordx"))[f"fmi{fmi}.xml"]
    if with_sources:
        code = code or sources(component, fmi)
        written |= {f"sources/{name}": content for name, content in code.items()}
        if fmi == 2:
            description = _with_source_files(description, compiled(code))
        else:
            written["sources/buildDescription.xml"] = _build_description(component.name, compiled(code))
    written["modelDescription.xml"] = description if isinstance(description, bytes) else description.encode()
    written["documentation/index.html"] = _documentation(component, vehicle).encode()
    licence = distribution("rotordx").read_text("licenses/LICENSE") or ""
    written["documentation/licenses/license.txt"] = licence.encode()
    if fmi == 2:
        written["model.png"] = icon()
    else:
        written |= {"terminalsAndIcons/icon.png": icon(), "terminalsAndIcons/terminalsAndIcons.xml": _ICON.encode()}
    return written


def icon(size: int = 128) -> bytes:
    """PNG of four rotors around a body, one of which has lost part of its thrust."""
    axis = np.linspace(-1, 1, size)
    x, y = np.meshgrid(axis, axis)
    image = np.zeros((size, size, 4), dtype=np.uint8)
    arms = (np.abs(np.abs(x) - np.abs(y)) < 0.06) & (np.abs(x) < 0.6)
    image[arms | (np.hypot(x, y) < 0.18)] = (60, 66, 74, 255)
    for i, (right, up) in enumerate(((1, -1), (-1, 1), (-1, -1), (1, 1))):
        distance = np.hypot(x - 0.6 * right, y - 0.6 * up)
        image[(distance < 0.36) & (distance > 0.27)] = (200, 60, 40, 255) if i == 0 else (40, 110, 180, 255)
    rows = b"".join(b"\0" + row.tobytes() for row in image)
    header = struct.pack(">IIBBBBB", size, size, 8, 6, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def _as_packaged(component: Component, fmi: int, name: str) -> bytes | None:
    """The library of the installed FMU, if it is for this platform and has the same start values."""
    path = fmu_path(component.name, fmi)
    if fmpy.read_model_description(str(path), validate=False).guid != token(component, version("rotordx")):
        return None
    with ZipFile(path) as archive:
        return archive.read(name) if name in archive.namelist() else None


def _documentation(component: Component, vehicle: Vehicle) -> str:
    """The component's README with the start values of this FMU; what it links within our sources is text here."""
    text = readme_path(component.name).read_text(encoding="utf-8")
    before, _, rest = text.partition(OPENING)
    after = rest.partition(CLOSING)[2]
    about = f"*rotordx {version('rotordx')}, start values for {vehicle.name}: {vehicle.description}*"
    page = f"{before}\n\n{about}\n\n{port_table(component)}\n\n{after}"
    body = MarkdownIt("commonmark").enable("table").render(page)
    body = re.sub(r'<a href="(?!https?:|#)[^"]*">(.*?)</a>', r"\1", body, flags=re.DOTALL)
    return _PAGE.format(name=html.escape(component.name), body=body)


def _with_source_files(description: str | bytes, names: Sequence[str]) -> bytes:
    """An FMI 2 model description that names the files to compile."""
    root = ET.fromstring(description)
    slave = root.find("CoSimulation")
    if slave is None:
        raise ValueError("a model description without <CoSimulation>")
    listed = ET.Element("SourceFiles")
    for name in names:
        ET.SubElement(listed, "File", name=name)
    slave.insert(0, listed)
    return _document(root)


def _build_description(identifier: str, names: Sequence[str]) -> bytes:
    """FMI 3: how the sources are compiled."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    options = " ".join(option for option in OPTIONS if not option.startswith("-D"))
    for language, suffix in (("C99", ".c"), ("C++17", ".cpp")):
        chosen = [name for name in names if name.endswith(suffix)]
        attributes = {"language": language, "compiler": "gcc", "compilerOptions": options}
        file_set = ET.SubElement(configuration, "SourceFileSet", attributes)
        for name in chosen:
            ET.SubElement(file_set, "SourceFile", name=name)
        for definition in DEFINITIONS:
            name, _, value = definition.partition("=")
            ET.SubElement(file_set, "PreprocessorDefinition", {"name": name, "value": value})
        ET.SubElement(file_set, "IncludeDirectory", name=".")
    return _document(root)


def _document(root: ET.Element) -> bytes:
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def write(files: dict[str, bytes], path: Path) -> None:
    """Write the archive, whole or not at all; the same files make the same bytes.

    Raises:
        UserError: the path cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pack(partial, files)
        partial.replace(path)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror}; choose another path with --out") from error
    finally:
        partial.unlink(missing_ok=True)
