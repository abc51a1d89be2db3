"""What a shared library says of itself, be it for Linux, Windows or macOS: exports, dependencies, where it was made."""

from __future__ import annotations

import re
from pathlib import Path

import fmpy
import lief

lief.logging.disable()

HEADERS = Path(fmpy.__file__).parent / "c-code"
#: macOS's names of the image itself, which zig's linker does not hide
IMAGE = {"__mh_dylib_header", "___dso_handle"}
#: what every machine has
SYSTEM_LIBRARIES = re.compile(r"lib[cm]\.so\.6|ld-linux.*|kernel32\.dll|api-ms-win-crt-.*|/usr/lib/libSystem\.B\.dylib")
OLDEST_GLIBC, OLDEST_MACOS = (2, 17), (11, 0)
DATE = 315532800  #: 1980-01-01, that of the files in an archive
PLACES = re.compile(rb"(?<![\w.])/(home|root|tmp|work|opt|Users|build|private)/|[A-Z]:\\|\.pdb")


def fmi_functions(fmi: int) -> set[str]:
    """Functions that the headers of the standard declare."""
    header = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    return set(re.findall(rf"FMI{fmi}_Export fmi{fmi}\w+TYPE\s+(fmi{fmi}\w+);", header))


def complaints(path: Path, fmi: int, portable: bool = True) -> list[str]:
    """What is wrong with the library of an FMU, nothing if it is right.

    Args:
        path: of the library.
        fmi: major version of FMI.
        portable: whether it has to run on every machine of its kind, not on this one only.
    """
    library = lief.parse(str(path))
    if isinstance(library, lief.ELF.Binary):
        exported = {s.name for s in library.dynamic_symbols if s.shndx != 0}
        needed = list(library.libraries)
        versions = {a.name for r in library.symbols_version_requirement for a in r.get_auxiliary_symbols()}
        fits = all(numbers(v.removeprefix("GLIBC_")) <= OLDEST_GLIBC for v in versions)
    elif isinstance(library, lief.PE.Binary):
        exported = {e.name for e in library.get_export().entries}
        needed = [i.name.lower() for i in library.imports]
        fits = not library.has_debug and library.header.time_date_stamps == DATE
    else:
        exported = {s.name for s in library.exported_symbols} - IMAGE
        exported = {name.removeprefix("_") for name in exported}
        needed = [entry.name for entry in library.libraries if entry.name != path.name]
        signed = library.has_code_signature or library.header.cpu_type != lief.MachO.Header.CPU_TYPE.ARM64
        fits = tuple(library.build_version.minos[:2]) == OLDEST_MACOS and signed
    told = PLACES.search(path.read_bytes())
    found = {
        f"exports {', '.join(sorted(exported ^ fmi_functions(fmi)))}": exported == fmi_functions(fmi),
        f"needs {', '.join(needed)}": all(SYSTEM_LIBRARIES.fullmatch(name) for name in needed),
        "does not run on old systems, is not signed, is dated, or refers to debugging data": fits or not portable,
        f"tells {told and told[0]!r}": told is None,
    }
    return [complaint for complaint, fine in found.items() if not fine]


def numbers(version: str) -> tuple[int, ...]:
    """2.17 as (2, 17)."""
    return tuple(int(part) for part in version.split("."))
