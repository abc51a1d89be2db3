"""The generated C computes what the CasADi functions compute."""

import ctypes
import subprocess
import sys

import numpy as np
import pytest

from rotordx.fmus.model_terms import generate

FLAGS = ["-O2", "-DNDEBUG", "-ffp-contract=off", "-fPIC"]

#: Arguments that are positive, and their scale in flight.
MAGNITUDES = {"rotor_speed": 200.0, "target_speed": 200.0, "dt": 0.001}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The generated files compiled, with an exported function call_<term> around each inline function of the header."""
    folder = tmp_path_factory.mktemp("model_terms")
    subprocess.run([sys.executable, "-m", "rotordx.fmus.model_terms.generate", "--out", folder], check=True)
    calls = ['#include "model_terms.h"']
    for function in generate.functions():
        name, count = function.name().removeprefix("casadi_"), function.n_in() + function.n_out()
        arrays = ", ".join(f"double* a{i}" for i in range(count))
        calls.append(f"void call_{name}({arrays}) {{ {name}({', '.join(f'a{i}' for i in range(count))}); }}")
    (folder / "calls.c").write_text("\n".join(calls) + "\n")
    command = ["cc", *FLAGS, "-shared", "-o", "terms.so", "calls.c", "model_terms.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "terms.so"))


@pytest.mark.parametrize("function", generate.functions(), ids=lambda f: f.name().removeprefix("casadi_"))
def test_c_equals_casadi(function, library, vehicle):
    call = getattr(library, "call_" + function.name().removeprefix("casadi_"))
    rng = np.random.default_rng(3)
    values = np.concatenate([np.ravel(getattr(vehicle, name)) for name in vars(vehicle)])
    for _ in range(1000):
        arguments = [
            values if name == "vehicle" else drawn(rng, name, size)
            for name, size in ((name, function.numel_in(name)) for name in function.name_in())
        ]
        expected = np.array(function(*arguments)).ravel(order="F")
        result = np.full(expected.size, np.nan)
        call(*(array.ctypes.data_as(ctypes.c_void_p) for array in (*map(np.ascontiguousarray, arguments), result)))
        np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12 * max(1, np.abs(expected).max()))


def drawn(rng, name, size):
    """Random argument of the size that it has in flight; a quaternion has the norm 1, a time step is positive."""
    values = rng.normal(0, 3, size)
    if name == "quaternion":
        return values / np.linalg.norm(values)
    if name in MAGNITUDES:
        return MAGNITUDES[name] * np.abs(values)
    return values


def test_the_header_serves_cpp(tmp_path):
    (tmp_path / "model_terms.h").write_text(generate.header())
    source = '#include "model_terms.h"\nint main() { double m[16], v[32] = {}; allocation(v, m); return m[0] != 0; }\n'
    (tmp_path / "main.cpp").write_text(source)
    command = ["c++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "main.cpp"]
    subprocess.run(command, cwd=tmp_path, check=True)
