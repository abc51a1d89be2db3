"""Libraries compiled for other platforms compute the same there: Windows under wine, aarch64 Linux under qemu-user.

Slow: the first use of a platform compiles its C library. `make platforms` runs it; what is not installed is skipped.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

from rotordx.orchestrator.export import fmu_export
from rotordx.orchestrator.export.fmu_compiler import PLATFORMS, chosen_platforms

STEPS = 500
HEADERS = Path(fmpy.__file__).parent / "c-code"
SYSROOT = Path("/usr/aarch64-linux-gnu")  #: of Debian's libc6-arm64-cross

#: Loads an FMI 3 library, steps it with inputs that swing, and prints its outputs after every 50th step.
DRIVER = r"""
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "fmi3FunctionTypes.h"
#ifdef _WIN32
#include <windows.h>
#define OPEN(path) LoadLibraryA(path)
#define FIND(library, name) GetProcAddress(library, name)
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif
#define GET(name) name##TYPE *name = (name##TYPE *)FIND(library, #name)

static void say(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String text) {
  fprintf(stderr, "%s\n", text);
}

int main(int argc, char **argv) {
  void *library = (void *)OPEN(argv[1]);
  if (!library) return 2;
  GET(fmi3InstantiateCoSimulation);
  GET(fmi3EnterInitializationMode);
  GET(fmi3ExitInitializationMode);
  GET(fmi3SetFloat64);
  GET(fmi3GetFloat64);
  GET(fmi3DoStep);
  GET(fmi3FreeInstance);
  void *m = fmi3InstantiateCoSimulation("x", argv[2], "", 0, 0, 0, 0, 0, 0, 0, say, 0);
  if (!m || fmi3EnterInitializationMode(m, 0, 0, 0, 0, 0) || fmi3ExitInitializationMode(m)) return 3;
  fmi3Boolean event, terminate, early;
  double last, values[64];
  for (int k = 0; k < STEPS; ++k) {
    for (int i = 0; i < INPUTS; ++i) {
      unsigned reference = input_references[i];
      for (int j = 0; j < input_sizes[i]; ++j) {  /* no mathematical library, so that the inputs are the same bits */
        int swing = (7 * k + 13 * reference + 29 * j) % 101 - 50;
        values[j] = input_rotor[i] ? 550 + swing : 0.002 * swing;
      }
      if (fmi3SetFloat64(m, &reference, 1, values, input_sizes[i])) return 4;
    }
    if (fmi3DoStep(m, k * 0.002, 0.002, 1, &event, &terminate, &early, &last)) return 5;
    for (int i = 0; (k + 1) % 50 == 0 && i < OUTPUTS; ++i) {
      unsigned reference = output_references[i];
      if (fmi3GetFloat64(m, &reference, 1, values, output_sizes[i])) return 6;
      for (int j = 0; j < output_sizes[i]; ++j) printf("%.17g ", values[j]);
    }
  }
  fmi3FreeInstance(m);
  return 0;
}
"""


def numbers(values: list[int]) -> str:
    return ", ".join(map(str, values)) or "0"


def driver_source(path: Path) -> str:
    """The driver with the tables of an FMU's inputs and outputs."""
    variables = fmpy.read_model_description(str(path)).modelVariables
    tables = f"#define STEPS {STEPS}\n"
    for causality in ("input", "output"):
        chosen = [v for v in variables if v.causality == causality]
        sizes = [int(v.dimensions[0].start) if v.dimensions else 1 for v in chosen]
        tables += (
            (
                f"#define {causality.upper()}S {len(chosen)}\n"
                f"static const unsigned {causality}_references[] = {{{numbers([v.valueReference for v in chosen])}}};\n"
                f"static const int {causality}_sizes[] = {{{numbers(sizes)}}};\n"
                f"static const int {causality}_rotor[] = {{{numbers(['rotor_speed' in v.name for v in chosen])}}};\n"
            )
            .replace("True", "1")
            .replace("False", "0")
        )
    return tables + DRIVER


def trajectory(folder: Path, name: str, target: str, runner: list[str]) -> np.ndarray:
    """Outputs of an FMU, exported for a platform, on that platform."""
    here = folder / target
    here.mkdir()
    component, vehicle = fmu_export.parametrised(name, "lab_x")
    files = fmu_export.contents(component, vehicle, 3, chosen_platforms(target, 3), with_sources=False, report=print)
    path = here / f"{name}.fmu"
    fmu_export.write(files, path)
    [library] = [file for file in files if file.startswith("binaries/")]
    with zipfile.ZipFile(path) as archive:
        archive.extract(library, here)
    (here / "driver.c").write_text(driver_source(path))
    program = here / "driver.exe"
    compiler = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        PLATFORMS[target].triple,
        "-O1",
        "-w",
        "-I",
        str(HEADERS),
    ]
    own = [] if target == "win64" else ["-ldl"]
    subprocess.run([*compiler, "-o", program, here / "driver.c", *own], check=True)
    token = fmpy.read_model_description(str(path)).guid
    command = [*runner, program, here / library, token]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    values: np.ndarray = np.array(result.stdout.split(), dtype=float)
    return values


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fdie", "plant", "controller", "sensors"])
@pytest.mark.parametrize(
    ("target", "tool"), [("win64", "wine"), ("aarch64-linux", "qemu-aarch64")], ids=["windows", "aarch64"]
)
def test_another_platform_computes_the_same(name, target, tool, tmp_path):
    pytest.importorskip("ziglang")
    if shutil.which(tool) is None:
        pytest.skip(f"{tool}, which runs the other platform's code here, is not installed")
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        pytest.skip("on this machine there is no x86_64 Linux library to compare with")
    runner = [tool] if target == "win64" else [tool, "-L", str(SYSROOT)]
    there, here = trajectory(tmp_path, name, target, runner), trajectory(tmp_path, name, "linux64", [])
    assert here.size > 10
    assert np.isfinite(here).any()
    # sine and square root come from another mathematical library
    np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9)
