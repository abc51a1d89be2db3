"""The build says in one sentence what is missing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2]
BIN = Path(sys.executable).parent


def configure(folder: Path, **environment: str) -> str:
    """Output of a CMake run that fails."""
    command = [BIN / "cmake", "-S", SOURCE, "-B", folder, "-G", "Ninja", f"-DPython_EXECUTABLE={sys.executable}"]
    result = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)
    assert result.returncode != 0
    return " ".join((result.stdout + result.stderr).split())


@pytest.mark.parametrize("missing", [{"PATH": str(BIN)}, {"CC": "no-such-compiler"}, {"CXX": "no-such-compiler"}])
def test_a_missing_compiler(missing, tmp_path):
    output = configure(tmp_path, **missing)
    assert output.count("CMake Error") == 1
    assert "rotordx needs a C and C++ compiler: install one, for example Debian's build-essential." in output


def test_a_missing_requirement(tmp_path):
    """A Python without casadi, fmpy, numpy and Eigen: one that does not look at its installed packages."""
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S "$@"\n')
    python.chmod(0o755)
    result = subprocess.run([python, SOURCE / "fmus" / "shell" / "requirements.py"], capture_output=True, text=True)
    assert result.returncode == 1
    assert result.stderr == ("rotordx needs the Python package numpy to be built: install the build requirements.\n")
