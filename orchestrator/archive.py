"""FMU archives: refused if they are hostile or unusable, else extracted once per process."""

from __future__ import annotations

import atexit
import re
import shutil
import stat
import tempfile
import zipfile
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import fmpy

from rotordx.orchestrator.errors import UserError

LARGEST_SIZE = 2**30  #: bytes that an archive may take when extracted
LARGEST_COUNT = 10_000  #: entries that an archive may have
LARGEST_DESCRIPTION = 2**26  #: bytes of a modelDescription.xml, which is read as a whole


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
        trusted: skip the validation of the model description, which takes most of the time.

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
    entries = _entries(path, "an FMU")
    size = sum(entry.file_size for entry in entries if entry.filename == "modelDescription.xml")
    if size > LARGEST_DESCRIPTION:
        raise UserError(f"{path} has a modelDescription.xml of {size / 2**20:.0f} MiB, more than an FMU's has")
    description = _description(path, validate=not trusted)
    binary = _binary(path, description)
    if binary not in {entry.filename for entry in entries}:
        raise UserError(f"{path} has no binary for this platform, it lacks {binary}")
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
    try:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
    except (OSError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(f"{path} is damaged and cannot be extracted: {error}") from error
    return folder


def _entries(path: Path, kind: str) -> list[zipfile.ZipInfo]:
    """Entries of an archive.

    Refused are entries that would be written outside the folder, that are no plain files, and sizes to fill a disk.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (OSError, zipfile.BadZipFile) as error:
        raise UserError(f"{path} is not {kind} or is truncated: {error}") from error
    for entry in entries:
        name = entry.filename
        parts = PurePosixPath(name).parts
        if "\\" in name or ":" in name or "\0" in name or name.startswith("/") or ".." in parts:
            raise UserError(f"{path} holds the entry {name!r}, which leads out of the folder of the FMU")
        if not (entry.is_dir() or stat.S_IFMT(entry.external_attr >> 16) in (0, stat.S_IFREG)):
            raise UserError(f"{path} holds the entry {name!r}, which is no plain file")
    total = sum(entry.file_size for entry in entries)
    if len(entries) > LARGEST_COUNT or total > LARGEST_SIZE:
        raise UserError(f"{path} would take {total / 2**20:.0f} MiB in {len(entries)} entries, more than an FMU does")
    return entries


def _description(path: Path, validate: bool) -> Any:
    try:
        with path.open("rb") as file:  # which FMPy would leave open after an error
            description = fmpy.read_model_description(file, validate=validate)
    except KeyError as error:
        raise UserError(f"{path} is not an FMU: it has no modelDescription.xml") from error
    except Exception as error:  # FMPy raises whatever a wrong document leads to, down to plain Exception
        problem = " ".join(str(error).split())
        raise UserError(f"{path} has a modelDescription.xml that is not valid: {problem}") from error
    if description.fmiVersion.partition(".")[0] not in ("2", "3"):
        raise UserError(f"{path} is an FMU of FMI {description.fmiVersion}, supported are 2 and 3")
    if description.coSimulation is None:
        raise UserError(f"{path} is not an FMU for co-simulation, export it as one")
    if not re.fullmatch(r"\w+", description.coSimulation.modelIdentifier):
        raise UserError(f"{path} has a modelIdentifier that is no identifier of C")
    return description


def _binary(path: Path, description: Any) -> str:
    """Name of the shared library within the archive."""
    folder = fmpy.platform if description.fmiVersion.startswith("2.") else fmpy.platform_tuple
    return f"binaries/{folder}/{description.coSimulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
