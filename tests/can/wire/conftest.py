"""The bus under test: each URL given with --bus, in a network of its own (tests/can/test_private_network.py)."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--bus", action="append", default=[], help="URL of a bus to test on; repeatable")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "bus" in metafunc.fixturenames:
        metafunc.parametrize("bus", metafunc.config.getoption("--bus"))


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts a program that is ended with the test."""
    with ExitStack() as stack:

        def begin(*command: str) -> subprocess.Popen[str]:
            return stack.enter_context(_ended(list(command), tmp_path))

        yield begin


@pytest.fixture
def rotordx(start) -> Callable[..., subprocess.Popen[str]]:
    """Starts a rotordx command."""
    code = "from rotordx.orchestrator.cli import main; main()"
    return lambda *arguments: start(sys.executable, "-c", code, *arguments)


@contextmanager
def _ended(command: list[str], folder: Path) -> Iterator[subprocess.Popen[str]]:
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, cwd=folder, stdout=pipe, stderr=pipe, text=True, start_new_session=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # with the processes that it has started
        process.communicate()


@pytest.fixture
def theirs(bus) -> str:
    """The bus as pydronecan names it."""
    interface, _, channel = bus.partition(":")
    if interface != "mcast":
        pytest.skip(f"pydronecan cannot send on {interface}: it calls flush_tx_buffer, which python-can does not have")
    return f"mcast:{channel}"
