"""An FMU is the same bytes wherever it is packed and holds nothing but what it must."""

from __future__ import annotations

import re
import subprocess
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmi_driver import FMUS, NAMES

from rotordx.fmus import fmu_path
from rotordx.fmus.shell.pack import pack, platform_folder


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_packing_again_gives_the_same_bytes(name, fmi, tmp_path):
    with zipfile.ZipFile(fmu_path(name, fmi)) as archive:
        files = {file: archive.read(file) for file in reversed(archive.namelist())}
    pack(tmp_path / "again.fmu", files)
    assert (tmp_path / "again.fmu").read_bytes() == fmu_path(name, fmi).read_bytes()


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_exports_the_functions_of_fmi_and_no_other(name, fmi, extracted):
    [library] = Path(extracted(name, fmi)).glob(f"binaries/*/{name}.*")
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    exported = {line.split()[-1].split("@")[0] for line in symbols.splitlines()}
    header = (Path(fmpy.__file__).parent / "c-code" / f"fmi{fmi}Functions.h").read_text()
    functions = set(re.findall(rf"FMI{fmi}_Export fmi{fmi}\w+TYPE\s+(fmi{fmi}\w+);", header))
    assert len(functions) > 40
    assert exported == functions


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_no_file_tells_where_it_was_built(name, fmi):
    with zipfile.ZipFile(fmu_path(name, fmi)) as archive:
        for file in archive.namelist():
            assert not re.search(rb"/(home|root|tmp|work|usr|Users|build)/", archive.read(file)), file


@pytest.mark.parametrize("name", NAMES)
def test_both_versions_have_one_token(name):
    tokens = {fmpy.read_model_description(str(fmu_path(name, fmi))).guid for fmi in (2, 3)}
    assert len(tokens) == 1


@pytest.mark.parametrize(
    ("fmi", "system", "machine", "folder"),
    [
        (2, "Linux", "x86_64", "linux64"),
        (2, "Windows", "AMD64", "win64"),
        (2, "Darwin", "arm64", "darwin64"),
        (3, "Linux", "x86_64", "x86_64-linux"),
        (3, "Linux", "aarch64", "aarch64-linux"),
        (3, "Windows", "AMD64", "x86_64-windows"),
        (3, "Darwin", "arm64", "aarch64-darwin"),
    ],
)
def test_platform_folders(fmi, system, machine, folder):
    assert platform_folder(fmi, system, machine) == folder
