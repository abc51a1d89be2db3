"""Compiles the sources of an FMU: for any platform with PyPI's ziglang, for this one with its own compiler; cached."""

from __future__ import annotations

import hashlib
import os
import platform
import secrets
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rotordx.fmus.shell.pack import platform_folder
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import RunError, UserError
from rotordx.orchestrator.export.fmu_sources import compiled

#: those of the build (CMakeLists.txt), so that the same additions are made in the same order
DEFINITIONS = ("NDEBUG=1", "EIGEN_NO_MALLOC=1", "CASADI_SYMBOL_EXPORT=")
OPTIONS = (
    *("-O2", "-g0", "-w", "-ffp-contract=off", "-fvisibility=hidden", "-ffunction-sections", "-fdata-sections"),
    *(f"-D{definition}" for definition in DEFINITIONS),
)
LANGUAGES = {
    ".c": ("-std=c99",),
    ".cpp": ("-std=c++17", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics", "-fvisibility-inlines-hidden"),
}


@dataclass(frozen=True)
class Platform:
    """Where an FMU can run."""

    name: str
    system: str  #: as `platform.system()` has it
    machine: str
    triple: str  #: for zig, with the oldest C library or system that it is to run with
    suffix: str  #: of a shared library

    def folder(self, fmi: int) -> str:
        """Folder of the binaries in an archive."""
        return platform_folder(fmi, self.system, self.machine)

    @property
    def is_here(self) -> bool:
        """Whether this process could load such a library."""
        return self.folder(3) == platform_folder(3, platform.system(), platform.machine())


PLATFORMS = {
    p.name: p
    for p in (
        Platform("linux64", "Linux", "x86_64", "x86_64-linux-gnu.2.17", ".so"),
        Platform("win64", "Windows", "AMD64", "x86_64-windows-gnu", ".dll"),
        Platform("darwin64", "Darwin", "x86_64", "x86_64-macos.11.0", ".dylib"),
        Platform("aarch64-linux", "Linux", "aarch64", "aarch64-linux-gnu.2.17", ".so"),
        Platform("aarch64-darwin", "Darwin", "arm64", "aarch64-macos.11.0", ".dylib"),
    )
}


def chosen_platforms(names: str | None, fmi: int) -> list[Platform]:
    """Platforms by their names with commas in between; None: this one.

    Raises:
        UserError: there is no such platform, or this version of FMI has no name for it.
    """
    if names is None:
        return [p for p in PLATFORMS.values() if p.is_here]
    chosen = []
    for name in dict.fromkeys(part.strip() for part in names.split(",")):
        if name not in PLATFORMS:
            raise UserError(f"--platforms: {name!r} must be {one_of(PLATFORMS, name)}")
        if fmi == 2 and name.startswith("aarch64"):
            raise UserError(f"--platforms: FMI 2 has no name for {name}, leave it out or export with --fmi 3")
        chosen.append(PLATFORMS[name])
    return chosen


def library(name: str, files: Mapping[str, bytes], target: Platform, report: Callable[[str], None]) -> bytes:
    """Shared library of an FMU.

    Args:
        name: of the FMU.
        files: see `fmu_sources.sources`.
        target: where it is to run.
        report: is told what takes time.

    Raises:
        UserError: there is no compiler for the platform.
        RunError: the compiler failed.
    """
    compiler = _Compiler.of(target)
    recipe = (target, compiler, OPTIONS, LANGUAGES, _link_options(target, compiler))
    content = repr((sorted(files.items()), recipe)).encode()
    cached = _cache() / f"{hashlib.sha256(content).hexdigest()}{target.suffix}"
    if not cached.is_file():
        patience = ", the first time for a platform takes minutes" if compiler.c[0] != "cc" else ""
        report(f"compiling {name} for {target.name}{patience}")
        built = _compile(name, files, target, compiler)
        cached.parent.mkdir(parents=True, exist_ok=True)
        partial = cached.with_name(f"{cached.name}.{secrets.token_hex(4)}")
        partial.write_bytes(built)
        partial.replace(cached)
    return cached.read_bytes()


@dataclass(frozen=True)
class _Compiler:
    """Commands, and what makes the compiler's output what it is."""

    c: tuple[str, ...]
    cpp: tuple[str, ...]
    version: str

    @classmethod
    def of(cls, target: Platform) -> _Compiler:
        try:
            zig = version("ziglang")
        except PackageNotFoundError:
            zig = None
        if zig is not None:
            base = (sys.executable, "-m", "ziglang")
            target_options = ("-target", target.triple, "-fno-sanitize=all")
            return cls((*base, "cc", *target_options), (*base, "c++", *target_options), zig)
        if target.is_here and shutil.which("cc") and shutil.which("c++"):
            told = subprocess.run(["cc", "--version"], capture_output=True, text=True, check=True).stdout
            return cls(("cc",), ("c++",), told)
        raise UserError(f"there is no compiler for {target.name}: pip install 'rotordx[platforms]'")


def _compile(name: str, files: Mapping[str, bytes], target: Platform, compiler: _Compiler) -> bytes:
    with tempfile.TemporaryDirectory(prefix="rotordx-") as place:
        for file, content in files.items():
            path = Path(place) / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        independent = () if target.system == "Windows" else ("-fPIC",)
        objects = []
        for i, file in enumerate(compiled(files)):
            suffix = Path(file).suffix
            command = compiler.c if suffix == ".c" else compiler.cpp
            objects.append(f"{i}.o")
            _run([*command, *OPTIONS, *LANGUAGES[suffix], *independent, "-I.", "-c", file, "-o", objects[-1]], place)
        output = f"{name}{target.suffix}"
        _run([*compiler.c, "-shared", *objects, *_link_options(target, compiler), "-o", output], place)
        return (Path(place) / output).read_bytes()


def _link_options(target: Platform, compiler: _Compiler) -> list[str]:
    """Leave out what is not called; zig's linkers damage libraries that they are to strip, but not Windows'."""
    options = {"Linux": ["-Wl,--gc-sections", "-lm"], "Darwin": ["-Wl,-dead_strip"], "Windows": ["-s"]}[target.system]
    return [*options, *(["-s"] if compiler.c[0] == "cc" and target.system == "Linux" else [])]


def _run(command: list[str], folder: str) -> None:
    """Run a compiler; what it dates (Windows' libraries have a time in them) is dated like the archive's files."""
    environment = os.environ | {"SOURCE_DATE_EPOCH": "315532800"}
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if result.returncode != 0:
        problem = " ".join((result.stderr or result.stdout).split())[:600]
        raise RunError(f"the compiler failed: {problem}")


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rotordx"
