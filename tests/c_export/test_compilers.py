"""No compiler and no checker has anything to say about the exported C, its example, its self-test or its wrappers."""

import sys

import pytest

from tests.c_export.toolchain import CORTEX_M4F, CORTEX_M7, PRECISIONS, STRICT, run

CPPCHECK = ["cppcheck", "--std=c99", "--enable=warning,portability,performance", "--error-exitcode=1", "--quiet",
            "--performance-valueflow-max-time=1",
            "-UROTORDX_SINGLE", "-UCASADI_SYMBOL_EXPORT", "-U__FAST_MATH__"]  # fmt: skip
#: above so many statements cppcheck takes minutes
LARGE = 1500
ZIG_TARGETS = [
    "x86_64-windows-gnu", "x86_64-macos", "aarch64-macos", "aarch64-linux-gnu", "x86_64-linux-gnu"
]  # fmt: skip


def programs(exported):
    return [exported.source, exported.folder / "main.c", exported.folder / "self_test.c"]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_clang_has_no_warning(exported, precision, tmp_path):
    for source in programs(exported):
        run(["clang", *STRICT, "-O1", *PRECISIONS[precision], "-c", source, "-o", "object.o"], tmp_path)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_gcc_has_no_warning_about_example_and_self_test(exported, precision, tmp_path):
    for source in programs(exported)[1:]:
        run(["gcc", *STRICT, "-O2", *PRECISIONS[precision], "-c", source, "-o", "object.o"], tmp_path)


@pytest.mark.parametrize(("precision", "optimisation"), [("single", "-O1"), ("double", "-O0")])
def test_cortex_m4f_has_no_warning(exported, precision, optimisation, tmp_path):
    """Its processor computes in single precision: nothing may be promoted to double then."""
    promotion = ["-Wdouble-promotion"] if precision == "single" else []
    chosen = [*CORTEX_M4F, *STRICT, *promotion, optimisation, *PRECISIONS[precision]]
    run([*chosen, "-c", exported.source, "-o", "object.o"], tmp_path)
    if precision == "single":
        assert not {"__aeabi_dmul", "__aeabi_dadd"} & set(run(["arm-none-eabi-nm", "object.o"], tmp_path).split())


def test_nothing_but_libm_is_called(exported, tmp_path):
    run([*CORTEX_M7, *STRICT, "-O1", "-c", exported.source, "-o", "object.o"], tmp_path)
    table = [line.split() for line in run(["arm-none-eabi-nm", "object.o"], tmp_path).splitlines()]
    undefined = {row[-1] for row in table if row[-2] == "U"}
    writable = {row[-1] for row in table if row[-2] in "BbDdCGgSs"}
    libm = {"exp", "expm1", "log", "log1p", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "pow", "fmod",
            "tanh", "sinh", "cosh", "fmin", "fmax", "hypot", "floor", "ceil"}  # fmt: skip
    assert undefined <= libm
    assert not writable  # no global state


def test_sanitizers_find_nothing(exported, tmp_path):
    chosen = ["gcc", "-std=c99", "-O0", "-g", "-ffp-contract=off", "-fsanitize=address,undefined"]
    sources = programs(exported)[::2]
    run([*chosen, "-fno-sanitize-recover=all", *sources, "-lm", "-o", "self_test"], tmp_path)
    assert "passed" in run([tmp_path / "self_test"])


def test_cppcheck_finds_nothing(exported):
    small = exported.source.read_text().count(";\n") <= LARGE
    run([*CPPCHECK, f"-I{exported.folder}", *programs(exported)[0 if small else 1 :]])


@pytest.mark.slow
def test_cppcheck_finds_nothing_in_large_diagnosers(exported):
    run([*CPPCHECK, f"-I{exported.folder}", exported.source])


@pytest.mark.slow
@pytest.mark.parametrize("target", ZIG_TARGETS)
def test_zig_compiles_for_other_platforms(exported, target, tmp_path):
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", target]
    for precision, flags in PRECISIONS.items():
        program = tmp_path / f"self_test_{precision}"
        run([*zig, *STRICT, "-O2", *flags, *programs(exported)[::2], "-lm", "-o", program], timeout=900)
        assert program.stat().st_size > 1000
        if target == "x86_64-linux-gnu":
            assert "passed" in run([program])
