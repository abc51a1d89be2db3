"""What CasADi prints becomes strict C99 that computes the same, for every operation that a step may use."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from rotordx.fmus.diagnosers.c99 import strict_source
from tests.c_export.toolchain import STRICT, run

x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
A, B = x[0], x[1]
OPERATIONS = [
    A + B, A - B, A * B, A / B, -A, A**2, 2 * A, 1 / B, A**B, ca.sqrt(A), ca.exp(A), ca.expm1(A), ca.log(A),
    ca.log1p(A), ca.sin(A), ca.cos(A), ca.tan(A), ca.asin(A / 9), ca.acos(A / 9), ca.atan(A), ca.atan2(A, B),
    ca.sinh(A), ca.cosh(A), ca.tanh(A), ca.asinh(A), ca.acosh(1 + A), ca.atanh(A / 9), ca.floor(A),
    ca.ceil(A), ca.fmod(A, B), ca.fabs(-A), ca.sign(A - B), ca.sign(y), ca.copysign(A, -B), ca.fmin(A, B),
    ca.fmax(A, B), ca.hypot(A, B), ca.erf(A), A < B, A <= B, A == B, A != B, ca.logic_not(y), ca.logic_and(A,
    y), ca.logic_or(A, y), ca.if_else(A > B, A, y), 0.1 * A, 1e-20 * A, A + ca.SX.inf(), A - ca.SX.inf(),
    ca.SX.nan(),
]  # fmt: skip


def printed(function: ca.Function) -> str:
    generator = ca.CodeGenerator("step", {"casadi_int": "int"})
    generator.add(function)
    return generator.dump()


def compiled(source: str, folder, precision=()):
    (folder / "step.c").write_text(source)
    for compiler in ("clang", "gcc"):
        run([compiler, *STRICT, "-Wdouble-promotion", "-O1", *precision, "-shared", "-fPIC", "step.c", "-lm",
             "-o", "step.so"], folder)  # fmt: skip
    return ctypes.CDLL(str(folder / "step.so")).f


def called(function, real, arguments, results):
    """Arrays as the generated function takes them; results may be arrays of the arguments."""
    pointer = ctypes.POINTER(real)
    pointers = [(pointer * len(side))(*(a.ctypes.data_as(pointer) for a in side)) for side in (arguments, results)]
    assert function(*pointers, None, None, 0) == 0


def test_every_operation_gives_what_casadi_gives(tmp_path):
    function = ca.Function("f", [x, y], [ca.vertcat(*OPERATIONS)], {"cse": True})
    step = compiled(strict_source("step.c", printed(function)), tmp_path)
    for values in ([0.7, 1.9], [2.5, 0.3]):
        result = np.empty(len(OPERATIONS))
        called(step, ctypes.c_double, [np.array(values), np.zeros(1)], [result])
        assert np.array_equal(result, np.array(function(values, 0.0)).ravel(), equal_nan=True)


def test_single_precision_has_nothing_of_double_precision(tmp_path):
    function = ca.Function("f", [x, y], [ca.vertcat(*OPERATIONS)], {"cse": True})
    step = compiled(strict_source("step.c", printed(function)), tmp_path, ["-DROTORDX_SINGLE"])
    result = np.empty(len(OPERATIONS), np.float32)
    called(step, ctypes.c_float, [np.array([0.7, 1.9], np.float32), np.zeros(1, np.float32)], [result])
    assert np.allclose(result, np.array(function([0.7, 1.9], 0.0)).ravel(), rtol=1e-5, equal_nan=True)


def test_a_state_advances_in_place(tmp_path):
    """Both elements are needed after one of them has been written."""
    function = ca.Function("f", [x], [ca.vertcat(B, A)])
    state = np.array([1.0, 2.0])
    called(compiled(strict_source("step.c", printed(function)), tmp_path), ctypes.c_double, [state], [state])
    assert state.tolist() == [2.0, 1.0]


def test_a_function_that_c99_does_not_have_is_refused():
    with pytest.raises(ValueError, match=r"step\.c: erfinv is no function of C99; write the step without it"):
        strict_source("step.c", printed(ca.Function("f", [y], [ca.erfinv(y)])))
