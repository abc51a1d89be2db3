"""Importers of FMUs besides ours, for tests that run an FMU elsewhere."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import pytest


def importer(name: str) -> ModuleType:
    """A module of another tool; without it the test is skipped.

    They are wheels with a foreign binary inside, which a machine may lack libraries for (ecospy: Debian's libtbb12,
    which .ci/run installs) or which is not made for it. That says nothing about this project.
    """
    try:
        return import_module(name)
    except (ImportError, OSError) as error:
        pytest.skip(f"{name} cannot be loaded: {error}")
