"""Instances of built FMUs for the tests of this folder."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import fmpy
import pytest
from fmi_driver import Instance

from rotordx.fmus import fmu_path


@pytest.fixture(scope="session")
def extracted(tmp_path_factory) -> Callable[[str, int], str]:
    """Folder of an extracted FMU, extracted once."""
    folders: dict[tuple[str, int], str] = {}

    def extract(name: str, fmi: int) -> str:
        if (name, fmi) not in folders:
            folder = str(tmp_path_factory.mktemp(f"{name}{fmi}"))
            folders[name, fmi] = fmpy.extract(str(fmu_path(name, fmi)), folder)
        return folders[name, fmi]

    return extract


@pytest.fixture
def instantiate(extracted) -> Iterator[Callable[..., Instance]]:
    """Makes instances that are freed at the end of the test."""
    with contextlib.ExitStack() as stack:

        def make(name: str, fmi: int, **options) -> Instance:
            instance = Instance(name, fmi, extracted(name, fmi), **options)
            stack.callback(instance.free)
            return instance

        yield make
