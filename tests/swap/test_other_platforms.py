"""FMUs exported for other platforms compute the same there: Windows under wine, aarch64 Linux under qemu-user.

What is for macOS cannot run here and is looked at only. Slow: `make platforms` runs it, and the first use of a platform
compiles its C library. What is not installed (Debian's wine, qemu-user, libc6-arm64-cross, clang) is skipped.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.build import build_platform_binary
from fmpy.validation import validate_fmu

from rotordx.fmus import component_names, diagnoser_ids, fmu_path
from rotordx.orchestrator.cli import main
from rotordx.orchestrator.export.fmu_compiler import PLATFORMS
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System
from tests.swap.libraries import HEADERS, complaints

pytestmark = pytest.mark.slow

#: all tests of one FMU run in the same process, which exports it once
FMUS = [pytest.param(n, marks=pytest.mark.xdist_group(n)) for n in [*component_names(), *diagnoser_ids()]]
DRIVER = Path(__file__).parent / "driver.c"
RUNNERS = {"linux64": [], "win64": ["wine"], "aarch64-linux": ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"]}
COMPILER = [sys.executable, "-m", "ziglang", "cc", "-O1", "-w", "-I", str(HEADERS), "-I", "."]

#: Largest difference relative to the largest value of an output: the mathematical libraries of the platforms round
#: sine, cosine, exp and expm1 differently in the last bit, and 2,000 steps of integration carry that on.
TOLERANCE = 1e-12


@pytest.fixture(scope="module")
def flown() -> dict[str, np.ndarray]:
    """What each FMU was given on a flight with a fault, row by row: time and inputs."""
    fault = {"rotor": 2, "onset_s": 1.0, "loss_of_effectiveness": 0.3}
    scenario = load_scenario("avram_circle", diagnosers=diagnoser_ids(), duration_s=4.0, faults=[fault])
    with System(scenario) as system:
        recording = fly(scenario, system)
        bus = np.hstack(
            [recording.signals[info.key].reshape(len(recording.time), -1) for info in system.wiring.signals]
        )
        return {name: np.c_[recording.time, bus[:, columns]] for name, columns in system.wiring.inputs.items()}


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Callable[[str, int], Path]:
    """Folder of an FMU exported for every platform that its version of FMI knows."""
    pytest.importorskip("ziglang")
    folder = tmp_path_factory.mktemp("exported")

    def export(name: str, fmi: int) -> Path:
        place = folder / f"{name}{fmi}"
        if not place.is_dir():
            platforms = ",".join(p for p in PLATFORMS if fmi == 3 or not p.startswith("aarch64"))
            options = ["--fmi", str(fmi), "--platforms", platforms, "--out", f"{place}.fmu", "--sources"]
            result = CliRunner().invoke(main, ["export", "fmu", name, *options])
            assert result.exit_code == 0, result.output
            assert validate_fmu(f"{place}.fmu") == []
            with zipfile.ZipFile(f"{place}.fmu") as archive:
                archive.extractall(place)
        return place

    return export


@pytest.fixture
def packaged(tmp_path) -> Callable[[str, int], Path]:
    """Folder of a packaged FMU, what this machine's compiler made."""
    return lambda name, fmi: Path(fmpy.extract(str(fmu_path(name, fmi)), tmp_path / "packaged"))


def tables(description: fmpy.model_description.ModelDescription) -> str:
    """The header that makes the driver one of this FMU."""
    text = f"#define FMI {description.fmiVersion[0]}\n"
    for causality in ("input", "output"):
        chosen = [v for v in description.modelVariables if v.causality == causality]
        size = sum(int(v.dimensions[0].start) if v.dimensions else 1 for v in chosen)
        references = ", ".join(str(v.valueReference) for v in chosen) or "0"
        text += f"#define {causality.upper()}S {size}\n"
        text += f"static const unsigned {causality}_references[] = {{{references}}};\n"
    return text


def outputs(fmu: Path, library: Path, target: str, rows: np.ndarray, place: Path) -> np.ndarray:
    """(rows, outputs) of an extracted FMU with one of its libraries, stepped on the system that it is for."""
    place.mkdir()
    description = fmpy.read_model_description(str(fmu))
    (place / "tables.h").write_text(tables(description))
    shutil.copy(DRIVER, place)  # zig's cache takes a header beside it for another one's if its own path is absolute
    shutil.copy(library, place)
    build = [*COMPILER, "-target", PLATFORMS[target].triple, "-o", "driver.exe", "driver.c"]
    subprocess.run([*build, *([] if target == "win64" else ["-ldl"])], cwd=place, check=True)
    rows.tofile(place / "inputs")
    command = [*RUNNERS[target], "./driver.exe", f"./{library.name}", description.guid, "inputs", "outputs"]
    subprocess.run(command, cwd=place, check=True, env=os.environ | {"WINEDEBUG": "-all"})
    return np.fromfile(place / "outputs").reshape(len(rows), -1)


def difference(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference relative to the largest value that an output takes."""
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    largest = np.nanmax(np.abs(expected), axis=0, initial=np.finfo(float).tiny)
    return float(np.nanmax(np.abs(found - expected) / largest, initial=0.0))


def binary(fmu: Path, fmi: int, target: str) -> Path:
    """The library of an extracted FMU for a platform."""
    [path] = (fmu / "binaries" / PLATFORMS[target].folder(fmi)).iterdir()
    return path


@pytest.mark.parametrize(
    ("target", "fmi"), [("linux64", 2), ("linux64", 3), ("win64", 2), ("win64", 3), ("aarch64-linux", 3)]
)
@pytest.mark.parametrize("name", FMUS)
def test_another_platform_computes_the_same(name, target, fmi, exported, packaged, flown, tmp_path):
    for tool in RUNNERS[target][:1]:
        if shutil.which(tool) is None:
            pytest.skip(f"{tool}, which runs the other platform's code here, is not installed")
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        pytest.skip("on this machine there is no x86_64 Linux library to compare with")
    own, fmu = packaged(name, fmi), exported(name, fmi)
    here = outputs(own, binary(own, fmi, "linux64"), "linux64", flown[name], tmp_path / "here")
    there = outputs(fmu, binary(fmu, fmi, target), target, flown[name], tmp_path / "there")
    assert name == "null" or np.nanmax(np.ptp(here, axis=0)) > 0
    error = difference(there, here)
    print(f"largest relative difference of {name}, FMI {fmi}, on {target}: {error:.1e}")
    assert error < TOLERANCE


@pytest.mark.parametrize(("c", "cpp"), [("gcc", "g++"), ("clang", "clang++")])
@pytest.mark.parametrize("name", FMUS)
def test_the_sources_compute_the_same_whoever_compiles_them(
    name, c, cpp, exported, packaged, flown, tmp_path, monkeypatch, capfd
):
    """By FMPy, as the build description says."""
    if shutil.which(cpp) is None:
        pytest.skip(f"{cpp} is not installed")
    own, fmu = packaged(name, 3), tmp_path / "fmu"
    here = outputs(own, binary(own, 3, "linux64"), "linux64", flown[name], tmp_path / "here")
    shutil.copytree(exported(name, 3), fmu)
    shutil.rmtree(fmu / "binaries")
    for variable, value in {"CC": c, "CXX": cpp, "CMAKE_GENERATOR": "Ninja"}.items():
        monkeypatch.setenv(variable, value)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "build").mkdir()
    build_platform_binary(fmu, tmp_path / "build")
    there = outputs(fmu, binary(fmu, 3, "linux64"), "linux64", flown[name], tmp_path / "there")
    np.testing.assert_array_equal(there, here)
    capfd.readouterr()  # of interest only if the test fails


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", FMUS)
def test_every_library_is_fit_for_all_machines_of_its_kind(name, fmi, exported):
    libraries = [path for path in (exported(name, fmi) / "binaries").rglob("*") if path.is_file()]
    assert len(libraries) == {2: 3, 3: 5}[fmi]
    assert {path.parent.name: complaints(path, fmi) for path in libraries} == {p.parent.name: [] for p in libraries}
