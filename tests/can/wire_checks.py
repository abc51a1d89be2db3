"""The command line of the tests in `wire`, which run in a network of their own."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

WIRE = Path(__file__).parent / "wire"


def pytest_on(buses: Iterable[str], *checks: Path) -> list[str]:
    """Command that runs checks (all, if none are named) on buses given by URL."""
    options = ["-p", "no:xdist", "-p", "no:cacheprovider", "-o", "addopts=", "-o", "python_files=check_*.py", "-q"]
    selected = [str(path) for path in checks or [WIRE]]
    return [sys.executable, "-m", "pytest", *options, *(f"--bus={bus}" for bus in buses), *selected]
