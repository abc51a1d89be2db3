"""The C and C++ of an FMU, complete: generated files, the FMI shell, and every header that they include."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Mapping
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from rotordx.fmus import component_names
from rotordx.fmus.model_terms.generate import header, source
from rotordx.fmus.shell.generate import generate
from rotordx.fmus.shell.ports import Component
from rotordx.orchestrator.errors import UserError

_INCLUDE = re.compile(rb'^\s*#\s*include\s*["<]([^">]+)[">]', re.MULTILINE)
_SHELL = {
    2: ("instance.cpp", "access.cpp", "fmi2.cpp"),
    3: ("instance.cpp", "access.cpp", "fmi3.cpp", "fmi3_unsupported.cpp"),
}


def sources(component: Component, fmi: int) -> dict[str, bytes]:
    """Files of an FMU that compile with their folder as the only one to search for headers: path -> contents.

    Raises:
        UserError: a header is nowhere to be found.
    """
    generated = generate(component, version("rotordx"))
    written = {name: _bytes(text) for name, text in generated.items() if not name.endswith(".xml")}
    if component.name in component_names():
        written |= {"model_terms.c": _bytes(source()), "model_terms.h": _bytes(header())}
    for name in [name for name in written if name.endswith(".c")]:
        # its header declares the functions for C, so that a C++ compiler takes the file, too
        written[name] = f'#include "{name.removesuffix(".c")}.h"\n'.encode() + written[name]
    written |= {f"fmus/shell/{name}": (_tree() / "shell" / name).read_bytes() for name in _SHELL[fmi]}
    return _with_headers(written)


def compiled(names: Mapping[str, bytes]) -> list[str]:
    """Those of the files that a compiler is given."""
    return sorted(name for name in names if name.endswith((".c", ".cpp")))


def _with_headers(written: dict[str, bytes]) -> dict[str, bytes]:
    """The files and all that they include, as far as it is not of the compiler's own library."""
    complete, waiting = dict(written), list(written)
    while waiting:
        name = waiting.pop()
        for match in _INCLUDE.findall(complete[name]):
            included = match.decode()
            beside = posixpath.normpath(posixpath.join(posixpath.dirname(name), included))
            for candidate in (beside, included):
                found = candidate in complete or _found(candidate)
                if isinstance(found, bytes):
                    complete[candidate] = found
                    waiting.append(candidate)
                if found:
                    break
    return complete


def _found(name: str) -> bytes | None:
    """A header of ours, of FMI or of Eigen; None: it is the compiler's."""
    places = {"fmus/": _tree().parent, "fmi": _package("fmpy") / "c-code"}
    if name.startswith("Eigen/"):
        places = {"Eigen/": _package("cmeel").parent / "cmeel.prefix" / "include" / "eigen3"}
    for prefix, folder in places.items():
        path = folder / name
        if name.startswith(prefix) and path.is_file():
            return path.read_bytes()
    return None


def _tree() -> Path:
    return Path(str(files("rotordx.fmus.shell") / "shell.hpp")).parent.parent


def _package(name: str) -> Path:
    spec = find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        raise UserError(f"compiling FMUs needs the Python package {name}: pip install 'rotordx[platforms]'")
    return Path(next(iter(spec.submodule_search_locations)))


def _bytes(text: str | bytes) -> bytes:
    return text.encode() if isinstance(text, str) else text
