"""Ctrl-C ends a run at any moment with a sentence, and leaves no result and no temporary files behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

#: `rotordx run` in which the flight gets SIGINT from itself at t = 0.5 s, so that it surely is in the middle
IN_THE_MIDDLE = """
import functools, os, signal
from rotordx.orchestrator import flight
from rotordx.orchestrator.cli import main

def interrupt(time, signals):
    if time == 0.5:
        os.kill(os.getpid(), signal.SIGINT)

flight.fly = functools.partial(flight.fly, callback=interrupt, callback_decimation=250)
main(["run", "hover"])
"""

#: `rotordx run` in which SIGINT comes while C calls Python: the exception is printed there and dropped
WITHIN_A_CALLBACK = """
import ctypes, os, signal
from rotordx.orchestrator.system import System
from rotordx.orchestrator.cli import main

initialise = System.initialise
callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))

def interrupted(*arguments):
    callback()
    initialise(*arguments)

System.initialise = interrupted
main(["run", "hover"])
"""


def start(arguments: list[str], folder: Path) -> subprocess.Popen[str]:
    (folder / "temporary").mkdir()
    environment = os.environ | {"TMPDIR": str(folder / "temporary")}
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def assert_interrupted(process: subprocess.Popen[str], folder: Path) -> None:
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (1, "")
    assert errors.splitlines()[-1] == "Error: interrupted, no result was written"
    assert [path.name for path in folder.iterdir()] == ["temporary"]
    assert not list((folder / "temporary").iterdir())


def test_in_the_middle_of_a_flight(tmp_path):
    assert_interrupted(start(["-c", IN_THE_MIDDLE], tmp_path), tmp_path)


def test_while_c_code_calls_back(tmp_path):
    assert_interrupted(start(["-c", WITHIN_A_CALLBACK], tmp_path), tmp_path)


@pytest.mark.parametrize("scenario", ["hover"])
def test_as_soon_as_it_says_what_it_flies(tmp_path, scenario):
    command = f"from rotordx.orchestrator.cli import main; main(['run', '{scenario}', '--set', 'duration_s=1200'])"
    process = start(["-c", command], tmp_path)
    assert process.stderr is not None
    assert process.stderr.readline() == "hover on lab_x: 1200 s\n"
    process.send_signal(signal.SIGINT)
    assert_interrupted(process, tmp_path)
