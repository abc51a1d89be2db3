"""SSP archives for tests: exported flights, archives with parts of them replaced, archives written by hand."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree import ElementTree as ET

from rotordx.fmus import fmu_path
from rotordx.orchestrator.export import fmu_export, ssp_export
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.ssp_archive import NAMESPACES

STEP = 0.002
FAULT = {"rotor": 3, "onset_s": 5.0, "loss_of_effectiveness": 0.3}
#: of avram_circle
CHANGES = {"duration_s": 5.5, "faults": [FAULT], "seed": 5}

STRUCTURE = "SystemStructure.ssd"


def without_compiler(name: str, *_) -> bytes:
    """Stands for `fmu_compiler.library`: the installed library, which refuses to start with other start values."""
    with zipfile.ZipFile(fmu_path(name, fmi=2)) as fmu:
        return fmu.read(next(entry for entry in fmu.namelist() if entry.startswith("binaries/")))


def exported(folder: Path, *, outputs: bool = False, **changes) -> Path:
    """avram_circle with changes as an archive."""
    path = folder / "flight.ssp"
    fmu_export.write(ssp_export.contents(load_scenario("avram_circle", **(CHANGES | changes)), outputs=outputs), path)
    return path


def rewritten(
    archive: Path,
    target: Path,
    change: Callable[[str], str] = lambda text: text,
    files: Mapping[str, bytes] | None = None,
) -> Path:
    """A copy with another structure and other files; contents of None are left out."""
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(target, "w") as result:
        contents = {name: source.read(name) for name in source.namelist()}
        contents[STRUCTURE] = change(contents[STRUCTURE].decode()).encode()
        for name, content in (contents | dict(files or {})).items():
            result.writestr(name, content)
    return target


def structure(archive: Path) -> ET.Element:
    """The root of an archive's system structure."""
    with zipfile.ZipFile(archive) as content:
        return ET.fromstring(content.read(STRUCTURE))


def without_parameter_sets(text: str) -> str:
    """A structure that binds no parameters."""
    root = ET.fromstring(text)
    for element in root.findall(".//ssd:Component", NAMESPACES):
        element.remove(element.find("ssd:ParameterBindings", NAMESPACES))
    return ET.tostring(root, encoding="unicode")


def written(folder: Path, system: str, *fmus: Path, units: str = "", stop: str = "0.01", **files: str) -> Path:
    """An archive of a system (what is within <ssd:System>), FMUs and other documents."""
    names = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in NAMESPACES.items())
    text = f"""<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="other" {names}><ssd:System name="s">{system}</ssd:System>
{units}<ssd:DefaultExperiment stopTime="{stop}"/></ssd:SystemStructureDescription>"""
    path = folder / "other.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(STRUCTURE, text)
        for fmu in fmus:
            archive.write(fmu, f"resources/{fmu.name}")
        for name, content in files.items():
            archive.writestr(name.replace("_", "."), content.replace("<NAMES>", names))
    return path


def component(name: str, *, fmu: str = "", inside: str = "", attributes: str = "") -> str:
    return f'<ssd:Component name="{name}" source="resources/{fmu or name}.fmu" {attributes}>{inside}</ssd:Component>'


def connector(name: str, kind: str, unit: str = "") -> str:
    unit = f'unit="{unit}"' if unit else ""
    return f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real {unit}/></ssd:Connector>'


def connection(start: str, end: str, inside: str = "", attributes: str = "") -> str:
    """Ends are "element.connector", or a connector of the system."""
    ends = ""
    for which, name in (("start", start), ("end", end)):
        element, _, own = name.rpartition(".")
        ends += f'{which}Element="{element}" ' if element else ""
        ends += f'{which}Connector="{own}" '
    return f"<ssd:Connection {ends} {attributes}>{inside}</ssd:Connection>"


def connectors(*parts: str) -> str:
    return f"<ssd:Connectors>{''.join(parts)}</ssd:Connectors>"


def system(elements: str, connections: str = "", *, own: str = "") -> str:
    joined = f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""
    return f"{own}<ssd:Elements>{elements}</ssd:Elements>{joined}"


def within(name: str, inside: str) -> str:
    return f'<ssd:System name="{name}">{inside}</ssd:System>'


def parameter(name: str, value: str, unit: str = "") -> str:
    unit = f'unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:Real value="{value}" {unit}/></ssv:Parameter>'


def bindings(*sets: str, mapping: str = "", attributes: str = "", units: str = "") -> str:
    """One binding for each set of parameters, the mapping in each of them."""
    text = "".join(
        f"<ssd:ParameterBinding {attributes}><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>{values}</ssv:Parameters>{units}</ssv:ParameterSet>'
        f"</ssd:ParameterValues>{mapping}</ssd:ParameterBinding>"
        for values in sets
    )
    return f"<ssd:ParameterBindings>{text}</ssd:ParameterBindings>"


def linear(**attributes: float) -> str:
    stated = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return f"<ssc:LinearTransformation {stated}/>"


def mapping(*entries: str) -> str:
    return (
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0">'
        f"{''.join(entries)}</ssm:ParameterMapping></ssd:ParameterMapping>"
    )


def entry(source: str, target: str, inside: str = "", attributes: str = "") -> str:
    return f'<ssm:MappingEntry source="{source}" target="{target}" {attributes}>{inside}</ssm:MappingEntry>'
