"""Whatever an isolated FMU does, the run ends with one sentence or goes on, and nothing is left over."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fmi3_fmu import Port
from fmi3_fmu import build as build_fmi3

from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from tests.orchestrator.foreign_fmu import build

#: What the FMU does, and where, is said by the environment, which its process inherits.
DO, MARK = "FOREIGN_FMU_DOES", "FOREIGN_FMU_OF"

MISBEHAVE = """
#include <fenv.h>
#include <pthread.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>
static int is(const char *where, const char *what) {
  char both[80];
  snprintf(both, sizeof both, "%s %s", what, where);
  return getenv("FOREIGN_FMU_DOES") && !strcmp(getenv("FOREIGN_FMU_DOES"), both);
}
static void *spin(void *unused) { for (;;); }
static void ignore(int number) {}
static void misbehave(const char *where) {
  if (is(where, "segfault")) *(volatile int *)0 = 1;
  if (is(where, "abort")) abort();
  if (is(where, "exit")) exit(0);
  if (is(where, "hang")) for (;;);
  if (is(where, "stop")) raise(SIGSTOP);
  if (is(where, "hang up")) { for (int i = 3; i < 1024; ++i) shutdown(i, SHUT_RDWR); for (;;); }
  if (is(where, "take all memory")) { while (calloc(1 << 20, 64)); abort(); }
  if (is(where, "fork")) if (!fork()) for (;;) pause();
  if (is(where, "interrupt us")) { kill(getppid(), SIGINT); for (;;); }
  if (is(where, "kill us")) { if (!fork()) for (;;) pause(); kill(getppid(), SIGKILL); }
  if (is(where, "fork and crash")) { if (!fork()) for (;;) pause(); abort(); }
  if (is(where, "print")) { printf("%c\\n\\xff{}garbage\\n", 0); fflush(stdout); fprintf(stderr, "loud\\n"); }
  if (is(where, "settle in")) {
    pthread_t thread;
    pthread_create(&thread, NULL, spin, NULL);
    fesetround(FE_UPWARD);
    chdir("/");
    umask(0777);
    for (int i = 1; i < 32; ++i) signal(i, ignore);
  }
}
"""
CRASHES = {
    "segfault": "it crashed: Segmentation fault",
    "abort": "it crashed: Aborted",
    "exit": "it ended with exit code 0",
    "hang": "it did not answer within 0.3 s and was stopped (timeout_s)",
}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory) -> Path:
    """Counts its steps; with `crash`, it does not survive the second one."""
    return build(
        tmp_path_factory.mktemp("foreign"),
        "bad",
        outputs=["y"],
        parameters={"crash": 0.0},
        prelude=MISBEHAVE,
        instantiate='misbehave("instantiation");',
        initialise='misbehave("initialisation");',
        step='if (time > 0.001) { misbehave("doStep"); if (V(crash)) abort(); } V(y) += 1;',
        free='misbehave("freeing");',
    )


@pytest.fixture
def does(monkeypatch, tmp_path) -> Iterator[Callable[[str], None]]:
    """Says what the FMU is to do; in the end no process may be left that was started by the test."""
    monkeypatch.setenv(MARK, str(tmp_path))
    yield lambda what: monkeypatch.setenv(DO, what)
    assert_nobody_left(str(tmp_path))


def assert_nobody_left(mark: str) -> None:
    """No other process has this mark in its environment, or soon none has: the kernel may still be at it."""
    marked, deadline = f"{MARK}={mark}".encode(), time.monotonic() + 10
    while left := [pid for pid in os.listdir("/proc") if pid.isdigit() and marked in environment(pid)]:
        assert time.monotonic() < deadline, left


def environment(pid: str) -> bytes:
    try:
        return b"" if int(pid) == os.getpid() else Path(f"/proc/{pid}/environ").read_bytes()
    except OSError:
        return b""


def alone(fmu: Path, **settings: object) -> Scenario:
    """Four steps of the FMU and nothing else."""
    (fmu.parent / "nothing.toml").write_text("")
    (fmu.parent / "alone.toml").write_text("duration_s = 0.008\nsystem = 'nothing.toml'\n")
    components = {"bad": {"fmu": str(fmu), "timeout_s": 0.3} | settings}
    return load_scenario(fmu.parent / "alone.toml", components=components)


@pytest.mark.parametrize("how", CRASHES)
@pytest.mark.parametrize(("where", "at"), [("instantiation", 0), ("initialisation", 0), ("doStep", 0.002)])
def test_a_crash_is_told_in_one_sentence(fmu, does, how, where, at):
    does(f"{how} {where}")
    with pytest.raises(ComponentError) as error:
        fly(alone(fmu))
    assert str(error.value) == f"bad failed at t = {at} s in {where}: {CRASHES[how]}"


@pytest.mark.parametrize("how", CRASHES)
def test_a_crash_after_the_flight_does_it_no_harm(fmu, does, how):
    does(f"{how} freeing")
    assert np.array_equal(fly(alone(fmu)).signals["bad.y"], range(5))


@pytest.mark.parametrize(
    ("what", "sentence"),
    [
        ("stop", "it did not answer within 0.3 s and was stopped (timeout_s)"),
        ("hang up", "it hung up"),
        ("fork and crash", "it crashed: Aborted"),
        ("take all memory", "it crashed: Aborted"),
    ],
)
def test_a_process_that_is_lost_is_ended(fmu, does, what, sentence):
    does(f"{what} doStep")
    with pytest.raises(ComponentError) as error:
        fly(alone(fmu, memory_mib=512))
    assert str(error.value) == f"bad failed at t = 0.002 s in doStep: {sentence}"


def test_it_is_freed_after_its_last_flight(tmp_path):
    freed = tmp_path / "freed"
    fmu = build(tmp_path, "bad", outputs=["y"], free=f'fclose(fopen("{freed}", "w"));')
    with System(alone(fmu)) as system:
        fly(alone(fmu), system)
        assert not freed.exists()
    assert freed.exists()


def test_processes_that_it_leaves_behind_end_with_it(fmu, does):
    does("fork doStep")
    assert np.array_equal(fly(alone(fmu)).signals["bad.y"], range(5))


def test_what_it_changes_for_itself_changes_nothing_for_others(fmu, does):
    settings = {"duration_s": 0.1, "faults": [], "components": {"bad": {"fmu": str(fmu)}}}
    does("nothing")
    expected = fly(load_scenario("avram_circle", **settings)).signals
    before = os.getcwd(), [signal.getsignal(number) for number in range(1, 32)]
    does("settle in doStep")
    signals = fly(load_scenario("avram_circle", **settings)).signals
    assert {k: v.tobytes() for k, v in signals.items()} == {k: v.tobytes() for k, v in expected.items()}
    assert (os.getcwd(), [signal.getsignal(number) for number in range(1, 32)]) == before


def test_what_it_prints_does_not_come_among_the_results(fmu, does, capfd):
    does("print doStep")
    assert np.array_equal(fly(alone(fmu)).signals["bad.y"], range(5))
    output, errors = capfd.readouterr()
    assert output == ""
    assert errors.count("garbage") == errors.count("loud") == 3


@pytest.mark.parametrize("isolate", [True, False])
def test_values_that_are_not_finite_are_logged_as_they_are(tmp_path, isolate):
    step = "V(y) = time > 0.005 ? NAN : time > 0.003 ? -INFINITY : 1;"
    fmu = build(tmp_path, "bad", outputs=["y"], step=step)
    assert np.array_equal(fly(alone(fmu, isolate=isolate)).signals["bad.y"], [0, 1, 1, -np.inf, np.nan], equal_nan=True)


@pytest.mark.parametrize("isolate", [True, False])
def test_an_fmu_that_asks_for_the_end_ends_the_run(tmp_path, isolate):
    fmu = build_fmi3(tmp_path, "bad", [Port("y", "output")], "if (time > 0.003) *terminate = fmi3True;")
    with pytest.raises(ComponentError) as error:
        fly(alone(fmu, isolate=isolate))
    assert str(error.value) == "bad failed at t = 0.004 s in doStep: it asked for the end of the simulation"


#: Each worker flies three times in one system, and the FMU crashes in the second flight; forked workers do so also
#: in the system that their parent has loaded.
WORKERS = """
import json, multiprocessing, sys
from concurrent.futures import ProcessPoolExecutor
from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System

def scenario(crash):
    components = {"bad": {"fmu": sys.argv[1], "parameters": {"crash": crash}}}
    return load_scenario("avram_circle", duration_s=0.1, faults=[], components=components)

def flight(system, crash):
    try:
        recording = fly(scenario(crash), system)
    except ComponentError as error:
        return str(error)
    return {key: values.tobytes().hex() for key, values in recording.signals.items()}

def three(number):
    with System(scenario(0.0)) as system:
        return [flight(system, crash) for crash in (0.0, 1.0, 0.0)]

def inherited(number):
    return [flight(loaded, crash) for crash in (0.0, 1.0, 0.0)]

if __name__ == "__main__":
    results = []
    with System(scenario(0.0)) as loaded:
        process = loaded.components["bad"]._process
        for method in ("spawn", "fork"):
            with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
                results += pool.map(three, range(2))
                if method == "fork":
                    results += pool.map(inherited, range(2))
        assert process.poll() is None  # its forks have left it alone
        results.append([flight(loaded, crash) for crash in (0.0, 1.0, 0.0)])
    json.dump(results, sys.stdout)
"""


def test_workers_survive_a_crash_and_fly_on_bit_for_bit(fmu, does, tmp_path):
    (tmp_path / "workers.py").write_text(WORKERS)
    command = [sys.executable, "-W", "ignore::DeprecationWarning", tmp_path / "workers.py", fmu]
    does("nothing")
    shown = subprocess.run(command, check=True, capture_output=True).stdout
    signals = fly(
        load_scenario("avram_circle", duration_s=0.1, faults=[], components={"bad": {"fmu": str(fmu)}})
    ).signals
    undisturbed = {key: values.tobytes().hex() for key, values in signals.items()}
    results = json.loads(shown)
    assert len(results) == 7
    for first, second, third in results:
        assert first == third == undisturbed
        assert second == "bad failed at t = 0.002 s in doStep: it crashed: Aborted"


def test_after_ctrl_c_while_it_hangs_the_next_flight_is_right(fmu, does):
    does("interrupt us doStep")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with System(alone(fmu, timeout_s=60.0)) as system:
            with pytest.raises(KeyboardInterrupt):
                fly(alone(fmu, timeout_s=60.0), system)
            does("nothing")
            assert np.array_equal(fly(alone(fmu, timeout_s=60.0), system).signals["bad.y"], range(5))
    finally:
        signal.signal(signal.SIGINT, before)


def test_if_we_are_killed_what_it_has_started_ends_too(fmu, does):
    does("kill us doStep")
    alone(fmu)  # writes the scenario
    command = [Path(sys.executable).with_name("rotordx"), "run", "alone.toml", "--set", f"components.bad.fmu={fmu}"]
    run = subprocess.run(command, cwd=fmu.parent, capture_output=True, text=True)
    assert run.returncode == -signal.SIGKILL
    assert "Traceback" not in run.stderr


def test_the_command_ends_with_one_sentence_and_no_result(fmu, does, tmp_path):
    does("segfault doStep")
    alone(fmu)  # writes the scenario
    command = [Path(sys.executable).with_name("rotordx"), "run", "alone.toml", "--out", tmp_path / "out"]
    overrides = ["--set", f"components.bad.fmu={fmu}"]
    run = subprocess.run([*command, *overrides], cwd=fmu.parent, capture_output=True, text=True)
    sentence = "Error: bad failed at t = 0.002 s in doStep: it crashed: Segmentation fault"
    assert (run.returncode, run.stdout, run.stderr.splitlines()[1:]) == (1, "", [sentence])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("how", "isolate"),
    [(signal.SIGINT, True), (signal.SIGTERM, True), (signal.SIGKILL, True), (signal.SIGTERM, False)],
)
def test_a_run_that_waits_for_an_fmu_can_be_ended(tmp_path, does, how, isolate):
    here = tmp_path / "here"
    fmu = build(tmp_path, "extra", outputs=["y"], step=f'fclose(fopen("{here}", "w")); for (;;);')
    (tmp_path / "mine.toml").write_text(
        f"duration_s = 1.0\n[components.extra]\nfmu = '{fmu}'\ntimeout_s = 600.0\nisolate = {str(isolate).lower()}\n"
    )
    command = [Path(sys.executable).with_name("rotordx"), "run", tmp_path / "mine.toml", "--out", tmp_path / "out"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    while not here.exists():
        assert process.poll() is None, process.communicate()
    process.send_signal(how)
    output, errors = process.communicate(timeout=30)
    assert (process.returncode, output) == (1 if how == signal.SIGINT else -how, "")
    assert errors.splitlines()[1:] == (["Error: interrupted, no result was written"] if how == signal.SIGINT else [])
    assert not (tmp_path / "out").exists()
