"""What an SSP archive holds is valid by the schemas of SSP 1.0, which FMPy has."""

from __future__ import annotations

from pathlib import Path

import fmpy
import pytest
from lxml import etree
from ssp_archives import CHANGES, without_compiler

from rotordx.orchestrator.export import fmu_export, ssp_export
from rotordx.orchestrator.scenario import load_scenario
from tests.orchestrator.foreign_fmu import build

SCHEMAS = Path(fmpy.__file__).parent / "ssp" / "schema"
SCHEMA_OF = {".ssd": "SystemStructureDescription.xsd", ".ssv": "SystemStructureParameterValues.xsd"}


@pytest.fixture(scope="module", autouse=True)
def nothing_is_compiled():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fmu_export, "library", without_compiler)
        yield


def mistakes(name: str, content: bytes) -> list[str]:
    """What is wrong with a document."""
    schema = etree.XMLSchema(file=str(SCHEMAS / SCHEMA_OF[Path(name).suffix]))
    schema.validate(etree.fromstring(content))
    return [error.message for error in schema.error_log]


def alone(folder: Path) -> dict:
    """A system of one FMU that nothing is connected with."""
    fmu = build(folder, "theirs", outputs=["z"], parameters={"k": 2.0})
    nothing = {"diagnosers": [], "faults": [], "gusts": False, "parameters": {}}
    return nothing | {"system": "replay", "components": {"theirs": {"fmu": str(fmu)}}}


def scaled(folder: Path) -> dict:
    """A connection with a transformation."""
    fmu = build(folder, "theirs", inputs=["x"], outputs=["z"])
    ports = {"a": {"variables": "x", "scale": -2.0, "unit": "deg"}}
    connections = [{"from": "plant.euler[1]", "to": "theirs.a"}]
    return {"components": {"theirs": {"fmu": str(fmu), "ports": ports}}, "connections": connections}


@pytest.mark.parametrize("outputs", [False, True])
@pytest.mark.parametrize("changes", [lambda _: {}, scaled, alone], ids=["avram_circle", "scaled", "alone"])
def test_all_documents_are_valid(changes, outputs, tmp_path):
    files = ssp_export.contents(load_scenario("avram_circle", **(CHANGES | changes(tmp_path))), outputs=outputs)
    documents = {name: content for name, content in files.items() if Path(name).suffix in SCHEMA_OF}
    assert len(documents) == 1 + sum(name.endswith(".fmu") for name in files)
    assert {name: mistakes(name, content) for name, content in documents.items()} == {name: [] for name in documents}


@pytest.mark.parametrize(
    ("document", "old", "new"),
    [
        ("SystemStructure.ssd", b' kind="input"', b""),
        ("SystemStructure.ssd", b"<ssd:Elements>", b"<ssd:Elements/><ssd:Elements>"),
        ("SystemStructure.ssd", b'stopTime="5.5"', b'stopTime="soon"'),
        ("resources/esc.ssv", b"ssv:Real value", b"ssv:Real values"),
    ],
)
def test_a_broken_document_is_found(document, old, new):
    content = ssp_export.contents(load_scenario("avram_circle", **CHANGES))[document]
    assert old in content
    assert mistakes(document, content.replace(old, new, 1))
