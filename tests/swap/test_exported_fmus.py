"""An exported FMU carries its vehicle and design, documentation, icon and licence, and is the same bytes every time."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.validation import validate_fmu
from lxml import etree

from rotordx.fmus import fmu_path
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.orchestrator.cli import main
from rotordx.orchestrator.export import fmu_compiler
from rotordx.orchestrator.export.fmu_compiler import chosen_platforms
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from tests.importers import importer
from tests.swap.compatibility import IMPORTERS, ROOT, TOLERANCE, difference, outcome
from tests.swap.libraries import complaints

SCHEMAS = Path(fmpy.__file__).parent / "schema" / "fmi3"


def export(*arguments: object) -> str:
    result = CliRunner().invoke(main, ["export", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """fdie for crazyflie in both versions, with sources."""
    folder = tmp_path_factory.mktemp("exported")
    for fmi in (2, 3):
        export("fmu", "fdie", "--vehicle", "crazyflie", "--fmi", fmi, "--sources", "--out", folder / f"fdie{fmi}.fmu")
    return folder


@pytest.mark.parametrize("fmi", [2, 3])
def test_it_is_valid_and_starts_at_the_vehicle_and_its_design(exported, fmi):
    path = exported / f"fdie{fmi}.fmu"
    assert validate_fmu(str(path)) == []
    starts = {v.name: v.start for v in fmpy.read_model_description(str(path)).modelVariables}
    expected = load_vehicle("crazyflie").parameters | load_design("crazyflie", "fdie")["parameters"]
    for name in ("mass", "observer_gain"):
        values = np.atleast_1d(expected[name])
        texts = starts.get(name) or " ".join(starts[f"{name}[{i + 1}]"] for i in range(values.size))
        assert [float(text) for text in texts.split()] == values.tolist()


INPUTS = {
    "rotor_speed_command": "controller.rotor_speed_command",
    "euler": "sensors.euler",
    "body_rate": "sensors.body_rate",
    "vertical_velocity": "sensors.vertical_velocity",
}


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_library_itself_has_these_start_values(exported, fmi, tmp_path):
    """Without a parameter set, it does what the packaged FMU does with all of them."""
    flown = fly(load_scenario("avram_circle", vehicle="crazyflie", duration_s=2.0, faults=[]))
    description = fmpy.read_model_description(str(exported / f"fdie{fmi}.fmu"))
    references = {v.name.removesuffix("[1]"): v.valueReference for v in description.modelVariables}
    fmu = (fmpy.fmi2.FMU2Slave if fmi == 2 else fmpy.fmi3.FMU3Slave)(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(exported / f"fdie{fmi}.fmu"), tmp_path),
        modelIdentifier="fdie",
        instanceName="fdie",
    )
    fmu.instantiate()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    for k in range(len(flown.time) - 1):
        for port, key in INPUTS.items():
            values = np.atleast_1d(flown.signals[key][k + 1]).tolist()
            if fmi == 2:
                fmu.setReal([references[port] + i for i in range(len(values))], values)
            else:
                fmu.setFloat64([references[port]], values)
        fmu.doStep(k * 0.002, 0.002)
    first = references["residual"]
    residual = fmu.getReal([first + i for i in range(4)]) if fmi == 2 else fmu.getFloat64([first], 4)
    fmu.freeInstance()
    np.testing.assert_array_equal(residual, flown.signals["fdie.residual"][-1])
    assert np.abs(residual).max() > 0


@pytest.mark.parametrize("fmi", [2, 3])
def test_it_brings_documentation_icon_and_licence(exported, fmi):
    with zipfile.ZipFile(exported / f"fdie{fmi}.fmu") as archive:
        page = archive.read("documentation/index.html").decode()
        assert b"BSD" in archive.read("documentation/licenses/license.txt")
        icon = archive.read("model.png" if fmi == 2 else "terminalsAndIcons/icon.png")
    assert icon.startswith(b"\x89PNG")
    for expected in ("crazyflie", "vertical_velocity", "loe_estimate", "<table>", "Avram", "v<sub>z</sub>"):
        assert expected in page
    assert not re.search(r'href="(?!https?:|#)', page), "links within our source tree lead nowhere in an FMU"


@pytest.mark.parametrize(
    ("file", "schema"),
    [
        ("sources/buildDescription.xml", "fmi3BuildDescription.xsd"),
        ("terminalsAndIcons/terminalsAndIcons.xml", "fmi3TerminalsAndIcons.xsd"),
        ("modelDescription.xml", "fmi3ModelDescription.xsd"),
    ],
)
def test_every_document_follows_its_schema(exported, file, schema):
    with zipfile.ZipFile(exported / "fdie3.fmu") as archive:
        document = etree.fromstring(archive.read(file))
    checked = etree.XMLSchema(etree.parse(SCHEMAS / schema))
    assert checked.validate(document), checked.error_log


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_sources_are_all_that_a_compiler_needs(exported, fmi, tmp_path):
    with zipfile.ZipFile(exported / f"fdie{fmi}.fmu") as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    if fmi == 2:
        listed = re.findall(r'<File name="([^"]+)"', (tmp_path / "modelDescription.xml").read_text())
    else:
        listed = re.findall(r'<SourceFile name="([^"]+)"', (sources / "buildDescription.xml").read_text())
    assert sorted(listed) == sorted(
        str(path.relative_to(sources)) for path in sources.rglob("*") if path.suffix in (".c", ".cpp")
    )
    if fmi == 3:  # one set of files for one compiler, which takes the C files as C++ then
        link = ["-x", "c++", "-std=c++17", "-w", "-fPIC", "-shared", "-Wl,--no-undefined", "-I.", "-o", "fdie.so"]
        subprocess.run(["c++", *link, *listed, "-lm"], cwd=sources, check=True)
        return
    for file in listed:
        compiler = ["cc", "-std=c99"] if file.endswith(".c") else ["c++", "-std=c++17"]
        subprocess.run([*compiler, "-fsyntax-only", "-w", "-I.", file], cwd=sources, check=True)


def test_the_sources_of_a_component_with_eigen_are_complete(tmp_path):
    export("fmu", "controller", "--sources", "--out", tmp_path / "controller.fmu")
    with zipfile.ZipFile(tmp_path / "controller.fmu") as archive:
        archive.extractall(tmp_path)
        packaged = zipfile.ZipFile(fmu_path("controller")).read("modelDescription.xml")
        assert archive.read("modelDescription.xml") == packaged, "the start values are those of the packaged FMU"
    command = ["c++", "-std=c++17", "-fsyntax-only", "-w", "-I."]
    subprocess.run([*command, "controller_component.cpp"], cwd=tmp_path / "sources", check=True)


def test_the_same_export_gives_the_same_bytes(exported, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # compiled anew
    again = tmp_path / "again.fmu"
    export("fmu", "fdie", "--vehicle", "crazyflie", "--fmi", 3, "--sources", "--out", again)
    assert again.read_bytes() == (exported / "fdie3.fmu").read_bytes()


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_compiled_library_tells_no_path_and_exports_fmi_only(exported, fmi, tmp_path):
    with zipfile.ZipFile(exported / f"fdie{fmi}.fmu") as archive:
        [name] = [name for name in archive.namelist() if name.startswith("binaries/")]
        assert complaints(Path(archive.extract(name, tmp_path)), fmi, portable=False) == []


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_compiles_the_sources_to_the_same_values(exported, fmi, tmp_path):
    """FMPy takes the first set of source files only, and definitions but no options."""
    whole, compiled = exported / f"fdie{fmi}.fmu", tmp_path / "fdie.fmu"
    with zipfile.ZipFile(whole) as archive, zipfile.ZipFile(compiled, "w") as stripped:
        for name in archive.namelist():
            if not name.startswith("binaries/"):
                stripped.writestr(name, archive.read(name))
    subprocess.run(
        [sys.executable, "-m", "fmpy", "compile", compiled], check=True, capture_output=True, env=with_own_tools()
    )
    assert outcome("FMPy", compiled).values == pytest.approx(outcome("FMPy", whole).values, abs=0, nan_ok=True)


def with_own_tools() -> dict[str, str]:
    """The environment with the commands of this Python's packages, CMake and ninja."""
    return os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "CMAKE_GENERATOR": "Ninja",
    }


@pytest.mark.parametrize("name", ["Ecos", "libcosim"])
def test_other_importers_find_the_values_of_fmpy(name):
    """Two cells of `make compatibility`."""
    importer(IMPORTERS[name].distribution)
    expected, found = (outcome(tool, fmu_path("fdie", 2)).values for tool in ("FMPy", name))
    assert found is not None
    assert difference(found, expected) <= TOLERANCE


def test_a_wheel_leaves_out_only_what_is_compiled_into_it():
    """Exports read C++, templates and documentation from the installed package."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["scikit-build"]["wheel"]
    packages = [ROOT / folder for folder in settings["packages"].values()]
    left_out = {path for package in packages for pattern in settings["exclude"] for path in package.glob(pattern)}
    assert {str(path.relative_to(ROOT)) for path in left_out} == {
        "fmus/CMakeLists.txt",
        "orchestrator/stepper.c",
        "orchestrator/report.png",
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fdi"], "'fdi' must be one of"),
        (["fdie", "--vehicle", "lab"], "did you mean `lab_x`?"),
        (["fdie", "--platforms", "win32"], "--platforms: 'win32' must be one of linux64, win64, darwin64"),
        (["fdie", "--out", "."], ". cannot be written: it is a folder; choose another path with --out"),
        (
            ["fdie", "--fmi", "2", "--platforms", "linux64, aarch64-linux"],
            "--platforms: FMI 2 has no name for aarch64-linux",
        ),
    ],
)
def test_mistakes_are_refused_in_one_sentence(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["export", "fmu", *arguments])
    assert result.exit_code == 2
    assert message in result.output
    assert not list(tmp_path.iterdir())


def test_without_ziglang_other_platforms_are_refused_and_this_one_is_compiled(tmp_path, monkeypatch):
    def version(package: str) -> str:
        raise PackageNotFoundError(package)

    monkeypatch.setattr(fmu_compiler, "version", version)
    monkeypatch.chdir(tmp_path)
    other = "win64" if chosen_platforms(None, 2)[0].name != "win64" else "linux64"
    result = CliRunner().invoke(main, ["export", "fmu", "null", "--vehicle", "crazyflie", "--platforms", other])
    assert result.exit_code == 2
    assert f"there is no compiler for {other}: pip install 'rotordx[platforms]'" in result.output
    assert not list(tmp_path.iterdir())
    export("fmu", "null", "--vehicle", "crazyflie")
    assert validate_fmu("null.fmu") == []
