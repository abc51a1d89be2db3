"""An archive that is hostile, damaged or no FMU at all is refused in one sentence, before anything is extracted."""

from __future__ import annotations

import re
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from foreign_fmu import build

from rotordx.fmus import fmu_path
from rotordx.orchestrator import archive
from rotordx.orchestrator.archive import open_archive
from rotordx.orchestrator.errors import UserError
from tests.swap.fmi3_fmu import Port
from tests.swap.fmi3_fmu import build as build_fmi3


@pytest.fixture
def root(tmp_path, monkeypatch) -> Path:
    """Where archives would be extracted."""
    folder = tmp_path / "extracted"
    folder.mkdir()
    monkeypatch.setattr(archive, "_extraction_root", lambda: str(folder))
    return folder


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    return build(tmp_path_factory.mktemp("built"), "foreign", outputs=["y"])


@pytest.fixture
def fmu(built, tmp_path) -> Path:
    return Path(shutil.copy(built, tmp_path))


def rewritten(fmu: Path, change: Callable[[str, bytes], bytes | None], add: Iterable[tuple] = ()) -> Path:
    """Copy of an FMU with changed, left out (None) and added entries."""
    path = fmu.with_name("changed.fmu")
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as target:
        for name in source.namelist():
            content = change(name, source.read(name))
            if content is not None:
                target.writestr(name, content)
        for entry, content in add:
            target.writestr(entry, content)
    return path


def symbolic_link() -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo("resources/link")
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry


def keep(_: str, content: bytes) -> bytes:
    return content


def with_nul(fmu: Path) -> Path:
    path = rewritten(fmu, keep, [("resourcesXx", "x")])
    path.write_bytes(path.read_bytes().replace(b"resourcesXx", b"resources\0x"))
    return path


def twice(fmu: Path) -> Path:
    path = rewritten(fmu, keep, [("resources/x", "x"), ("resources/y", "x")])
    path.write_bytes(path.read_bytes().replace(b"resources/y", b"resources/x"))
    return path


def encrypted(fmu: Path) -> Path:
    """The flag is set in every entry's head and in the directory."""
    content = bytearray(rewritten(fmu, keep).read_bytes())
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        for match in re.finditer(re.escape(signature), bytes(content)):
            content[match.start() + flags] |= 1
    path = fmu.with_name("changed.fmu")
    path.write_bytes(content)
    return path


def compressed(name: str, method: int) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name)
    entry.compress_type = method
    return entry


MANY = b"".join(
    b'<ScalarVariable name="x%d" valueReference="%d"><Real/></ScalarVariable>' % (i, i) for i in range(200_000)
)

REFUSALS = {
    "leads out of it": (
        lambda fmu: rewritten(fmu, keep, [("../../escaped.txt", "x")]),
        r"holds the entry '../../escaped.txt', which leads out of the folder",
    ),
    "absolute path": (
        lambda fmu: rewritten(fmu, keep, [("/tmp/escaped.txt", "x")]),
        "'/tmp/escaped.txt', which leads out",
    ),
    "backslashes": (lambda fmu: rewritten(fmu, keep, [("resources\\..\\x", "x")]), "which leads out of the folder"),
    "drive letter": (lambda fmu: rewritten(fmu, keep, [("C:x", "x")]), "'C:x', which leads out of the folder"),
    "symbolic link": (
        lambda fmu: rewritten(fmu, keep, [(symbolic_link(), "/etc")]),
        "'resources/link', which is no plain file",
    ),
    "name with NUL": (lambda fmu: with_nul(fmu), r"holds the entry 'resources\\x00x', which leads out of the folder"),
    "entry twice": (
        lambda fmu: twice(fmu),
        "holds the entry 'resources/x' more than once$",
    ),
    "encrypted": (lambda fmu: encrypted(fmu), "is encrypted, export it without a password$"),
    "packed with LZMA": (
        lambda fmu: rewritten(fmu, keep, [(compressed("resources/x", zipfile.ZIP_LZMA), "x")]),
        "is compressed with another method than deflate, zip it anew$",
    ),
    "no description": (
        lambda fmu: rewritten(fmu, lambda name, content: None if name.endswith(".xml") else content),
        r"is not an FMU: it has no modelDescription.xml",
    ),
    "description is no XML": (
        lambda fmu: rewritten(fmu, lambda name, content: b"<fmi" if name.endswith(".xml") else content),
        r"has a modelDescription.xml that is not valid: ",
    ),
    "description breaks the schema": (
        lambda fmu: rewritten(fmu, lambda _, content: content.replace(b'causality="output"', b'causality="outcome"')),
        r"has a modelDescription.xml that is not valid: .*causality",
    ),
    "identifier leads elsewhere": (
        lambda fmu: rewritten(
            fmu, lambda _, content: content.replace(b'Identifier="foreign"', b'Identifier="../foreign"')
        ),
        r"has a modelIdentifier that is no identifier of C",
    ),
    "model exchange": (
        lambda fmu: rewritten(
            fmu,
            lambda _, content: content.replace(b"CoSimulation", b"ModelExchange").replace(
                b' canHandleVariableCommunicationStepSize="true"', b""
            ),
        ),
        r"is not an FMU for co-simulation, export it as one",
    ),
    "binary for another machine": (
        lambda fmu: rewritten(fmu, lambda name, c: c[:18] + b"\xb7\0" + c[20:] if name.startswith("binaries") else c),
        r"has a binaries/\w+/foreign\.\w+ for another machine than this one: export it for this one$",
    ),
    "binary that is none": (
        lambda fmu: rewritten(fmu, lambda name, content: b"MZ" if name.startswith("binaries") else content),
        r"has a binaries/\w+/foreign\.\w+ for another machine than this one: export it for this one$",
    ),
    "FMI 1": (
        lambda fmu: rewritten(fmu, lambda _, content: content.replace(b'fmiVersion="2.0"', b'fmiVersion="1.0"')),
        r"is an FMU of FMI 1.0, supported are 2 and 3: export it as one of these$",
    ),
    "no version": (
        lambda fmu: rewritten(fmu, lambda _, content: content.replace(b'fmiVersion="2.0"', b"")),
        r"is not an FMU: its modelDescription.xml has no fmiVersion$",
    ),
    "document type": (
        lambda fmu: rewritten(fmu, lambda _, c: c.replace(b"?><", b"?><!DOCTYPE a SYSTEM 'file:///etc/hostname'><")),
        r"has a modelDescription.xml that is not valid: it has a DOCTYPE, which FMI does not use: remove it$",
    ),
    "document type of the build description": (
        lambda fmu: rewritten(fmu, keep, [("sources/buildDescription.xml", "<!DOCTYPE a><fmiBuildDescription/>")]),
        r"has a sources/buildDescription.xml that is not valid: it has a DOCTYPE",
    ),
    "a million variables": (
        lambda fmu: rewritten(fmu, lambda _, c: c.replace(b"</ModelVariables>", MANY + b"</ModelVariables>")),
        r"has a modelDescription.xml that is not valid: it has more than 300000 elements, export it without local",
    ),
    "no binary": (
        lambda fmu: rewritten(fmu, lambda name, content: None if name.startswith("binaries") else content),
        r"has no binary for this platform, it lacks binaries/\w+/foreign\.\w+: export it for this one too$",
    ),
}


@pytest.mark.parametrize("kind", REFUSALS)
def test_it_is_refused_before_anything_is_extracted(kind, fmu, root):
    make, message = REFUSALS[kind]
    path = make(fmu)
    with pytest.raises(UserError, match=message) as error:
        open_archive(path)
    assert str(error.value).startswith(f"{path} ")
    assert "\n" not in str(error.value)
    assert not list(root.iterdir())
    assert not list(fmu.parent.parent.glob("**/escaped.txt"))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.99])
def test_a_truncated_archive_is_refused(share, tmp_path, root):
    content = fmu_path("plant").read_bytes()
    path = tmp_path / "plant.fmu"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(UserError, match=r"plant.fmu is not an FMU or is truncated: "):
        open_archive(path)
    assert not list(root.iterdir())


def test_a_damaged_library_is_refused(fmu, root):
    with zipfile.ZipFile(fmu) as source:
        entry = next(entry for entry in source.infolist() if entry.filename.startswith("binaries"))
        middle = entry.header_offset + entry.file_size // 2
    content = bytearray(fmu.read_bytes())
    content[middle] ^= 0xFF
    fmu.write_bytes(content)
    with pytest.raises(UserError, match=r"foreign.fmu is damaged and cannot be extracted: Bad CRC-32"):
        open_archive(fmu)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_damaged_compressed_data_are_refused(fmu, root, share):
    path = rewritten(fmu, keep)
    with zipfile.ZipFile(path) as source:
        entry = next(entry for entry in source.infolist() if entry.filename.startswith("binaries"))
    content, first = bytearray(path.read_bytes()), entry.header_offset + 30 + len(entry.filename)
    begin = first + int(share * entry.compress_size)
    content[begin : begin + 16] = b"\xff" * 16
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"changed.fmu is damaged and cannot be extracted: "):
        open_archive(path)


def test_an_archive_that_would_fill_the_disk_is_refused(fmu, root, monkeypatch):
    monkeypatch.setattr(archive, "LARGEST_SIZE", 2**20)
    path = rewritten(fmu, keep, [("resources/zeros", bytes(2**20))])
    assert path.stat().st_size < 2**16
    with pytest.raises(UserError, match=r"would take 1 MiB in 3 entries, more than an FMU does"):
        open_archive(path)
    assert not list(root.iterdir())


def test_a_huge_description_is_refused_unread(fmu, root, monkeypatch):
    monkeypatch.setattr(archive, "LARGEST_DOCUMENT", 2**20)
    path = rewritten(fmu, lambda name, content: content + b" " * 2**20 if name.endswith(".xml") else content)
    with pytest.raises(UserError, match=r"has a modelDescription.xml of 1 MiB, more than an FMU's has"):
        open_archive(path)
    assert not list(root.iterdir())


def test_a_description_whose_entities_explode_is_refused(fmu, root):
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 20 if i else "boom" * 20}">' for i in range(12))

    def explode(name: str, content: bytes) -> bytes:
        if not name.endswith(".xml"):
            return content
        head, _, rest = content.partition(b"?>")
        body = rest.replace(b'modelName="foreign"', b'modelName="&e11;"')
        return head + f"?><!DOCTYPE fmiModelDescription [{entities}]>".encode() + body

    with pytest.raises(UserError, match=r"has a modelDescription.xml that is not valid: ") as error:
        open_archive(rewritten(fmu, explode))
    assert "\n" not in str(error.value)
    assert not list(root.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('valueReference="1" c', 'valueReference="0" c', "two variables have the value reference 0$"),
        (
            '<Dimension start="3"/>',
            '<Dimension valueReference="77"/>',
            "a dimension is the variable with the value reference 77, which does not exist$",
        ),
        (
            '<Dimension start="3"/>',
            '<Dimension start="1000000"/><Dimension start="1000000"/>',
            "has variables of more than 200000 values, export it with fewer$",
        ),
    ],
)
def test_arrays_that_cannot_be_are_refused(tmp_path, root, old, new, message):
    fmu = build_fmi3(tmp_path, "foreign", [Port("u", "input", 3), Port("y", "output")], "")
    with pytest.raises(UserError, match=message):
        open_archive(rewritten(fmu, lambda _, content: content.replace(old.encode(), new.encode())))
    assert not list(root.iterdir())


def test_variables_of_fmi_2_may_share_a_value_reference(tmp_path, root):
    fmu = build(tmp_path, "foreign", outputs=["y", "alias"])
    path = rewritten(fmu, lambda _, content: content.replace(b'valueReference="1"', b'valueReference="0"'))
    assert [v.valueReference for v in open_archive(path).description.modelVariables] == [0, 0]


def test_an_archive_with_too_many_entries_is_refused(fmu, root, monkeypatch):
    monkeypatch.setattr(archive, "LARGEST_COUNT", 10)
    path = rewritten(fmu, keep, [(f"resources/{i}", "") for i in range(10)])
    with pytest.raises(UserError, match=r"in 12 entries, more than an FMU does"):
        open_archive(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(UserError, match=r"none.fmu cannot be read: No such file or directory"):
        open_archive(tmp_path / "none.fmu")
    (tmp_path / "folder.fmu").mkdir()
    with pytest.raises(UserError, match=r"folder.fmu is not an FMU or is truncated: .*Is a directory"):
        open_archive(tmp_path / "folder.fmu")


def test_the_same_file_is_extracted_once_and_a_new_one_again(fmu, root):
    assert open_archive(fmu).folder == open_archive(fmu).folder
    fmu.write_bytes(fmu_path("null", 2).read_bytes())
    assert open_archive(fmu).description.modelName == "null"
    assert len(list(root.iterdir())) == 2
