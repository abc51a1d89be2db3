"""FMU archives: refused if they are hostile or unusable, else extracted once per process."""

from __future__ import annotations

import atexit
import re
import shutil
import stat
import sys
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from math import prod
from pathlib import Path, PurePosixPath
from typing import Any
from xml.parsers import expat

import fmpy

from rotordx.orchestrator.errors import UserError

LARGEST_SIZE = 2**30  #: bytes that an archive may take when extracted
LARGEST_COUNT = 10_000  #: entries that an archive may have
LARGEST_DOCUMENT = 2**26  #: bytes of an XML document, which is read as a whole
LARGEST_ELEMENT_COUNT = 300_000  #: elements of such a document, of which each becomes objects
LARGEST_VALUE_COUNT = 200_000  #: values of all variables, of which each becomes an object

_DESCRIPTION = "modelDescription.xml"
_DOCUMENTS = (_DESCRIPTION, "sources/buildDescription.xml")  # what FMPy reads


@dataclass(frozen=True)
class Archive:
    """An extracted FMU for co-simulation."""

    path: Path  #: the .fmu file
    folder: Path  #: where it is extracted
    description: Any  #: fmpy.model_description.ModelDescription

    @property
    def fmi(self) -> int:
        """Major version of FMI, 2 or 3."""
        return int(self.description.fmiVersion.partition(".")[0])


def open_archive(path: Path, *, trusted: bool = False) -> Archive:
    """Check and extract an FMU; the same file is extracted once per process, and removed when the process ends.

    Args:
        path: the .fmu file.
        trusted: skip the check of the documents, which takes most of the time.

    Raises:
        UserError: it is no FMU for co-simulation with a binary for this platform, or its content is hostile.
    """
    try:
        status = path.stat()
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}") from error
    return _open(path.absolute(), trusted, status.st_mtime_ns, status.st_size)


@cache
def _extraction_root() -> str:
    root = tempfile.mkdtemp(prefix="rotordx-")
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return root


@cache
def _open(path: Path, trusted: bool, modified_ns: int, file_size: int) -> Archive:
    """`open_archive` for one state of a file, which its time of modification and size stand for."""
    entries = {entry.filename: entry for entry in _entries(path, "an FMU")}
    if _DESCRIPTION not in entries:
        raise UserError(f"{path} is not an FMU: it has no {_DESCRIPTION}")
    for name in () if trusted else _DOCUMENTS:
        if name in entries:
            _check_document(path, entries[name])
    description = _description(path, validate=not trusted)
    binary = _binary(path, description)
    if binary not in entries:
        raise UserError(f"{path} has no binary for this platform, it lacks {binary}: export it for this one too")
    if not _runs_here(path, binary):
        raise UserError(f"{path} has a {binary} for another machine than this one: export it for this one")
    return Archive(path, _extracted(path), description)


def extract(path: Path, kind: str) -> Path:
    """Check and extract an archive that holds something else than an FMU; it is removed when the process ends.

    Args:
        path: of the archive.
        kind: what it should be, with an article, for messages.

    Raises:
        UserError: it is no archive, or its content is hostile.
    """
    _entries(path, kind)
    return _extracted(path)


def _extracted(path: Path) -> Path:
    folder = Path(tempfile.mkdtemp(prefix=f"{path.stem}-", dir=_extraction_root()))
    with _damage_refused(path), zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


@contextmanager
def _damage_refused(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(f"{path} is damaged and cannot be extracted: {error}") from error


def _entries(path: Path, kind: str) -> list[zipfile.ZipInfo]:
    """Entries of an archive.

    Refused are entries that would be written outside the folder, that are no plain files, and sizes to fill a disk.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (OSError, zipfile.BadZipFile) as error:
        raise UserError(f"{path} is not {kind} or is truncated: {error}") from error
    names = Counter(entry.filename for entry in entries)
    for entry in entries:
        name = entry.orig_filename  # which is not cut off where it has a NUL
        parts = PurePosixPath(name).parts
        if "\\" in name or ":" in name or "\0" in name or name.startswith("/") or ".." in parts:
            raise UserError(f"{path} holds the entry {name!r}, which leads out of the folder of the FMU")
        if not (entry.is_dir() or stat.S_IFMT(entry.external_attr >> 16) in (0, stat.S_IFREG)):
            raise UserError(f"{path} holds the entry {name!r}, which is no plain file")
        if names[entry.filename] > 1:
            raise UserError(f"{path} holds the entry {name!r} more than once")
        if entry.flag_bits & 1:
            raise UserError(f"{path} is encrypted, export it without a password")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise UserError(f"{path} is compressed with another method than deflate, zip it anew")
    total = sum(entry.file_size for entry in entries)
    if len(entries) > LARGEST_COUNT or total > LARGEST_SIZE:
        raise UserError(f"{path} would take {total / 2**20:.0f} MiB in {len(entries)} entries, more than an FMU does")
    return entries


@dataclass
class _Document:
    """What is to know about a document before it becomes a tree of objects in memory."""

    elements: int = 0
    version: str | None = None
    depth: int = 0
    section: str = ""  #: element below the root
    references: list[str] = field(default_factory=list)  #: value references of the variables
    dimensions: set[str] = field(default_factory=set)  #: value references that dimensions refer to

    def begin(self, tag: str, attributes: Mapping[str, str]) -> None:
        """The beginning of an element."""
        self.elements += 1
        self.depth += 1
        if self.depth == 1:
            self.version = attributes.get("fmiVersion")
        if self.depth == 2:
            self.section = tag
        if self.elements > LARGEST_ELEMENT_COUNT:
            raise ValueError(f"it has more than {LARGEST_ELEMENT_COUNT} elements, export it without local variables")
        reference = attributes.get("valueReference")
        if reference is not None and self.section == "ModelVariables":
            if tag == "Dimension":
                self.dimensions.add(reference)
            else:
                self.references.append(reference)

    def end(self, _: str) -> None:
        """The end of an element."""
        self.depth -= 1

    def refuse(self, *_: object) -> None:
        """A document type, with entities that may fill the memory or name files of this machine."""
        raise ValueError("it has a DOCTYPE, which FMI does not use: remove it")


def _check_document(path: Path, entry: zipfile.ZipInfo) -> None:
    """Refuse a document that could fill the memory, and what FMPy would stumble over."""
    if entry.file_size > LARGEST_DOCUMENT:
        raise UserError(f"{path} has a {entry.filename} of {entry.file_size / 2**20:.0f} MiB, more than an FMU's has")
    document, parser = _Document(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = document.begin, document.end
    parser.StartDoctypeDeclHandler = document.refuse
    try:
        with zipfile.ZipFile(path) as archive, archive.open(entry) as file:
            parser.ParseFile(file)
        if entry.filename == _DESCRIPTION:
            _check_version(path, document.version)
            if document.version and document.version.startswith("3"):
                _check_references(document)
    except (OSError, ValueError, expat.ExpatError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(f"{path} has a {entry.filename} that is not valid: {error}") from error


def _check_version(path: Path, version: str | None) -> None:
    if version is None:
        raise UserError(f"{path} is not an FMU: its {_DESCRIPTION} has no fmiVersion")
    if version.partition(".")[0] not in ("2", "3"):
        raise UserError(f"{path} is an FMU of FMI {version}, supported are 2 and 3: export it as one of these")


def _check_references(document: _Document) -> None:
    twice = [reference for reference, count in Counter(document.references).items() if count > 1]
    unknown = document.dimensions.difference(document.references)
    if twice:
        raise ValueError(f"two variables have the value reference {twice[0]}")
    if unknown:
        raise ValueError(f"a dimension is the variable with the value reference {min(unknown)}, which does not exist")


def _description(path: Path, validate: bool) -> Any:
    try:
        with path.open("rb") as file:  # which FMPy would leave open after an error
            description = fmpy.read_model_description(file, validate=validate)
    except Exception as error:  # FMPy raises whatever a wrong document leads to, down to plain Exception
        problem = " ".join(str(error).split())
        raise UserError(f"{path} has a {_DESCRIPTION} that is not valid: {problem}") from error
    if sum(prod(variable.shape or (1,)) for variable in description.modelVariables) > LARGEST_VALUE_COUNT:
        raise UserError(f"{path} has variables of more than {LARGEST_VALUE_COUNT} values, export it with fewer")
    if description.coSimulation is None:
        raise UserError(f"{path} is not an FMU for co-simulation, export it as one")
    if not re.fullmatch(r"\w+", description.coSimulation.modelIdentifier):
        raise UserError(f"{path} has a modelIdentifier that is no identifier of C")
    return description


def _binary(path: Path, description: Any) -> str:
    """Name of the shared library within the archive."""
    folder = fmpy.platform if description.fmiVersion.startswith("2.") else fmpy.platform_tuple
    return f"binaries/{folder}/{description.coSimulation.modelIdentifier}{fmpy.sharedLibraryExtension}"


def _runs_here(path: Path, binary: str) -> bool:
    """Whether a library is made for the machine that Python is made for; only an ELF file tells."""

    def machine(head: bytes) -> bytes | None:
        return head[4:6] + head[18:20] if head.startswith(b"\x7fELF") else None  # word size, byte order and machine

    with Path(sys.executable).open("rb") as python:
        ours = machine(python.read(20))
    with _damage_refused(path), zipfile.ZipFile(path) as archive, archive.open(binary) as library:
        return ours is None or machine(library.read(20)) == ours
