"""What an export says of itself is true: its commands work as typed in an empty folder with nothing but gcc."""

import os
import re
import shutil
import sys
from pathlib import Path

import pytest

from rotordx.fmus.vehicles import load_design
from tests.c_export.toolchain import run


@pytest.fixture
def home(exported, tmp_path):
    """A copy outside the project."""
    return shutil.copytree(exported.folder, tmp_path / "home")


@pytest.fixture
def only_gcc(tmp_path):
    """An environment in which nothing but a compiler, make and the shell's tools can be found."""
    tools = tmp_path / "tools"
    tools.mkdir()
    for tool in ("gcc", "as", "ld", "make", "mkdir", "sh"):
        (tools / tool).symlink_to(shutil.which(tool))
    return {"PATH": str(tools), "HOME": str(tmp_path)}


def test_commands_of_its_readme_work_as_typed(exported, home, only_gcc):
    commands = re.search(r"^```sh\n(.*?)^```", (home / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    said = run(["/bin/sh", "-e", "-c", commands[1]], home, env=only_gcc)
    found = load_design("lab_x", exported.diagnoser) is not None
    assert ("it is rotor 1" in said) == found
    assert ("no fault detected" in said) == (not found)
    assert re.findall(r"(double|single) precision, 5000 steps: passed", said) == ["double", "single"]


@pytest.mark.xdist_group("c_export_fdie")
@pytest.mark.parametrize("change", ["0.2015", "0.20"])
def test_self_test_fails_if_the_diagnoser_answers_otherwise(exports, change, tmp_path):
    """Another drag coefficient is another diagnoser, whether it comes to the same verdict or not."""
    home = shutil.copytree(exports("fdie").folder, tmp_path / "home")
    source = home / "rotordx_fdie.c"
    source.write_text(
        source.read_text().replace(".drag_coefficient = ROTORDX_REAL(0.25)", f".drag_coefficient = {change}")
    )
    run(["gcc", "-std=c99", "-O1", "-ffp-contract=off", "self_test.c", source, "-lm", "-o", "self_test"], home)
    with pytest.raises(AssertionError, match="FAILED: step"):
        run(["./self_test"], home)


@pytest.mark.xdist_group("c_export_fdie")
def test_fast_math_is_refused(exports, tmp_path):
    with pytest.raises(AssertionError, match="compile without -ffast-math"):
        run(["gcc", "-std=c99", "-ffast-math", "-c", exports("fdie").source, "-o", "object.o"], tmp_path)


@pytest.mark.xdist_group("c_export_fdie")
@pytest.mark.parametrize("options", [[], ["-DROTORDX_SINGLE=ON"]])
def test_cmake_builds_and_tests_it(exports, options, tmp_path):
    folder, build = exports("fdie").folder, tmp_path / "build"
    installed = Path(sys.executable).parent  # a requirement of the build
    run([installed / "cmake", "-S", folder, "-B", build, *options], env=os.environ | {"CC": "gcc"})
    run([installed / "cmake", "--build", build])
    run([installed / "ctest", "--test-dir", build, "--output-on-failure"])


@pytest.mark.xdist_group("c_export_fdie")
def test_two_diagnosers_fit_into_one_firmware(exports, tmp_path):
    first, second = exports("fdie"), exports("null")
    (tmp_path / "both.c").write_text(
        '#include "rotordx_fdie.h"\n#include "rotordx_null.h"\n'
        "int main(void) {\n"
        "  rotordx_fdie_state fdie;\n  rotordx_fdie_outputs said;\n"
        "  rotordx_null_state null;\n  rotordx_null_outputs nothing;\n"
        "  return rotordx_fdie_init(&fdie, &rotordx_fdie_lab_x, &said) != ROTORDX_OK ||\n"
        "         rotordx_null_init(&null, &rotordx_null_lab_x, &nothing) != ROTORDX_OK;\n}\n"
    )
    include = [f"-I{first.folder}", f"-I{second.folder}"]
    run(
        ["gcc", "-std=c99", "-Wall", "-Werror", *include, "both.c", first.source, second.source, "-lm", "-o", "b"],
        tmp_path,
    )
    run([tmp_path / "b"])
