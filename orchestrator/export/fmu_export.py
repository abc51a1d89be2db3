"""The archive that `rotordx export fmu` writes: an FMU whose start values are those of a vehicle and its design."""

from __future__ import annotations

import dataclasses
import html
import os
import re
import struct
import zlib
from base64 import b64encode
from collections.abc import Callable, Sequence
from importlib.metadata import distribution, version
from pathlib import Path
from xml.etree import ElementTree as ET
from zipfile import ZipFile

import fmpy
import numpy as np
from markdown_it import MarkdownIt
from markdown_it.token import Token

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
<meta name="viewport" content="width=device-width">
<title>{name}</title>
<style>
body {{ font: 16px/1.5 "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; color: #1c2024; max-width: 62em;
  margin: 2em auto; padding: 0 1.2em; }}
h1 {{ font-size: 1.6em; line-height: 1.25; }}
h2 {{ font-size: 1.2em; margin: 2em 0 0.5em; padding-bottom: 0.2em; border-bottom: 1px solid #d8dbdd; }}
table {{ display: block; overflow-x: auto; border-collapse: collapse; font-size: 0.9em; }}
td, th {{ border: 1px solid #d8dbdd; padding: 0.25em 0.7em; text-align: left; vertical-align: top; }}
th {{ background: #f2f4f5; font-weight: 600; }}
code, pre {{ font: 0.9em ui-monospace, "DejaVu Sans Mono", Consolas, monospace; }}
code, pre {{ background: #f2f4f5; border-radius: 3px; }}
code {{ padding: 0.1em 0.25em; }}
h1 code, th code, pre code {{ background: none; padding: 0; }}
pre {{ padding: 0.7em 1em; overflow-x: auto; }}
sub {{ line-height: 0; }}
a {{ color: #0067a5; }}
#icon {{ float: right; width: 80px; margin: 0 0 0.5em 1.5em; }}
</style>
</head>
<body>
<img id="icon" src="{icon}" alt="">
{body}
</body>
</html>
"""

#: a symbol of one letter, perhaps with a hat or bar, and its index: v_z, ϑ̂_s
_INDEXED = re.compile(r"(?<!\w)([^\W\d_][\u0300-\u036f]*)_(\w+)")

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

    For this machine alone the library is the installed one, if it has the start values; to be passed on, all are
    compiled to run on old systems, too.

    Raises:
        UserError: a platform cannot be compiled for.
        RunError: the compiler failed.
    """
    written = {f"binaries/{p.folder(fmi)}/{component.name}{p.suffix}": b"" for p in platforms}
    code: dict[str, bytes] = {}
    alone = [p.is_here for p in platforms] == [True]
    for name, target in zip(written, platforms, strict=True):
        built = _as_packaged(component, fmi, name) if alone else None
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
    title, _, text = text.partition("\n")
    before, _, rest = text.partition(OPENING)
    after = rest.partition(CLOSING)[2]
    about = f"*rotordx {version('rotordx')}, start values for {vehicle.name}: {vehicle.description}*"
    page = f"{title}\n\n{about}\n{before}\n\n{port_table(component)}\n\n{after}"
    markdown = MarkdownIt("commonmark").enable("table")
    markdown.add_render_rule("text", _with_indices)
    body = re.sub(r'<a href="(?!https?:|#)[^"]*">(.*?)</a>', r"\1", markdown.render(page), flags=re.DOTALL)
    image = f"data:image/png;base64,{b64encode(icon()).decode()}"
    return _PAGE.format(name=html.escape(component.name), icon=image, body=body)


def _with_indices(renderer: object, tokens: Sequence[Token], index: int, options: object, env: object) -> str:
    """Text as HTML, with what follows the underscore of a symbol set lower."""
    return _INDEXED.sub(r"\1<sub>\2</sub>", html.escape(tokens[index].content))


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
    """FMI 3: how the sources are compiled.

    One set of files for C and C++, as FMPy compiles the first set only; the C files are valid C++ as well.
    """
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    options = " ".join(option for option in OPTIONS if not option.startswith("-D"))
    attributes = {"language": "C++17", "compiler": "gcc", "compilerOptions": options}
    file_set = ET.SubElement(configuration, "SourceFileSet", attributes)
    for name in names:
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


def check_place(path: Path) -> None:
    """Find out before the work whether an archive could be put there.

    Raises:
        UserError: it could not.
    """
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if path.is_dir():
        raise _cannot_write(path, "it is a folder")
    if not folder.is_dir():
        raise _cannot_write(path, f"{folder.name} is a file")
    if not os.access(folder, os.W_OK):
        raise _cannot_write(path, f"{folder} may not be written to")


def write(files: dict[str, bytes], path: Path) -> None:
    """Write the archive, whole or not at all; the same files make the same bytes.

    Raises:
        UserError: the path cannot be written.
    """
    check_place(path)
    partial = path.with_name(f".{path.name}.partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        pack(partial, files)
        partial.replace(path)
    except OSError as error:
        raise _cannot_write(path, error.strerror or str(error)) from error
    finally:
        partial.unlink(missing_ok=True)


def _cannot_write(path: Path, reason: str) -> UserError:
    return UserError(f"{path} cannot be written: {reason}; choose another path with --out")
