"""Exports of every diagnoser, made once; all tests of one diagnoser run in the same process."""

from __future__ import annotations

import functools

import pytest

from rotordx.fmus import diagnoser_ids
from tests.c_export.toolchain import Export, export

WRAPPERS = ("px4", "crazyflie", "rtos")


def pytest_generate_tests(metafunc):
    if "diagnoser" in metafunc.fixturenames:
        groups = [pytest.param(d, marks=pytest.mark.xdist_group(f"c_export_{d}")) for d in diagnoser_ids()]
        metafunc.parametrize("diagnoser", groups)


@pytest.fixture(scope="session")
def exports(tmp_path_factory):
    """Function: diagnoser -> its export with all wrappers."""
    return functools.cache(lambda name: export(name, tmp_path_factory.mktemp("c") / name, wrappers=WRAPPERS))


@pytest.fixture
def exported(exports, diagnoser) -> Export:
    return exports(diagnoser)
