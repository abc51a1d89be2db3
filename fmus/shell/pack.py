"""Packs a model description and a library into an FMU; equal contents make equal bytes."""

from __future__ import annotations

import argparse
import platform
from pathlib import Path
from typing import IO
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

_FMI3_ARCHITECTURES = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}
_FMI2_SYSTEMS = {"windows": "win", "linux": "linux", "darwin": "darwin"}


def platform_folder(fmi: int, system: str, machine: str) -> str:
    """Folder of the binaries of a platform: "linux64" in FMI 2.0, "x86_64-linux" in FMI 3.0.

    FMI 2.0 tells platforms apart by system and pointer size only.
    """
    system, machine = system.lower(), machine.lower()
    architecture = _FMI3_ARCHITECTURES.get(machine, machine)
    if fmi == 2:
        return f"{_FMI2_SYSTEMS[system]}{32 if architecture == 'x86' else 64}"
    return f"{architecture}-{system}"


def pack(path: Path | IO[bytes], files: dict[str, bytes]) -> None:
    """Writes an archive of `files` (name in the archive -> contents), sorted by name and dated 1980-01-01."""
    with ZipFile(path, "w") as archive:
        for name, contents in sorted(files.items()):
            info = ZipInfo(name)
            info.compress_type = ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, contents)


def main() -> None:
    """Command of the build: pack one FMU."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fmu", type=Path)
    parser.add_argument("--fmi", type=int, choices=(2, 3), required=True)
    parser.add_argument("--description", type=Path, required=True)
    parser.add_argument("--library", type=Path, required=True)
    parser.add_argument("--system", default=platform.system())
    parser.add_argument("--machine", default=platform.machine())
    arguments = parser.parse_args()
    folder = platform_folder(arguments.fmi, arguments.system, arguments.machine)
    files = {
        "modelDescription.xml": arguments.description.read_bytes(),
        f"binaries/{folder}/{arguments.library.name}": arguments.library.read_bytes(),
    }
    arguments.fmu.parent.mkdir(parents=True, exist_ok=True)
    pack(arguments.fmu, files)


if __name__ == "__main__":
    main()
