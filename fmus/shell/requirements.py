"""Command of the build: where the Python packages that it needs are installed, as a CMake list."""

import sys
from importlib.util import find_spec
from pathlib import Path

REQUIRED = ("numpy", "casadi", "fmpy", "cmeel")


def locations() -> tuple[str, Path, Path]:
    """(search path of the packages, folder of the FMI headers, prefix of Eigen); exits if a package is missing."""
    folders: dict[str, Path] = {}
    for package in REQUIRED:
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            sys.exit(f"rotordx needs the Python package {package} to be built: install the build requirements.")
        folders[package] = Path(next(iter(spec.submodule_search_locations)))
    path = ":".join(dict.fromkeys(str(folder.parent) for folder in folders.values()))
    return path, folders["fmpy"] / "c-code", folders["cmeel"].parent / "cmeel.prefix"


if __name__ == "__main__":
    print(*(str(location) for location in locations()), sep=";")
