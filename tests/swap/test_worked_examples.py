"""The examples of the orchestrator's README work as printed: another tool's controller here, fdie in another tool."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np

from rotordx.orchestrator import results
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from tests.importers import importer

README = (Path(__file__).parents[2] / "orchestrator" / "README.md").read_text(encoding="utf-8")


def block(language: str, beginning: str) -> str:
    """The code block of the README that begins with a line."""
    [found] = [
        b
        for b in re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
        if b.startswith(beginning)
    ]
    return found


def made_with_pythonfmu3(name, folder):
    """Puts an example's FMU and its scenario into a folder."""
    importer("pythonfmu3")
    (folder / f"{name}.py").write_text(block("python", f"# {name}.py"))
    (folder / f"{name}.toml").write_text(block("toml", f"# {name}.toml"))
    build = [sys.executable, "-m", "pythonfmu3", "build", "-f", f"{name}.py"]
    subprocess.run(build, cwd=folder, check=True, capture_output=True)


def test_a_controller_made_with_pythonfmu3_flies(tmp_path):
    made_with_pythonfmu3("hover", tmp_path)
    flown = fly(load_scenario(tmp_path / "hover.toml")).signals
    assert flown["controller.rotor_speed_command"].shape == (4001, 4)
    np.testing.assert_allclose(flown["plant.position"][-1], [0.0, 0.0, -2.5], atol=0.02)


def test_a_diagnoser_made_with_pythonfmu3_is_scored_beside_ours(tmp_path):
    made_with_pythonfmu3("imbalance", tmp_path)
    run = [Path(sys.executable).with_name("rotordx"), "run", "imbalance.toml"]
    shown = subprocess.run(run, cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    recording, summary = results.read(tmp_path / "results" / "imbalance")
    for name in ("fdie", "theirs"):
        score = summary["diagnosers"][name]
        assert (score["fault_detected"], score["false_alarm"], score["isolation_correct"]) == (True, False, True)
        assert 0 < score["detection_delay_s"] <= score["isolation_delay_s"] < 2
        assert abs(score["loe_final_error"]) < 0.05
    printed = re.findall(r"^(?:diagnoser|fdie|theirs)  .*(?=  )", README, re.MULTILINE)  # but for the computing time
    assert len(printed) == 3
    assert all(line in shown for line in printed)
    assert set(recording.signals["theirs.fault_detected"]) == {0.0, 1.0}
    assert set(recording.signals["theirs.faulty_rotor"]) == {0.0, 3.0}

    replay = next(line for line in README.splitlines() if line.startswith("rotordx replay") and "imbalance" in line)
    command = [Path(sys.executable).with_name("rotordx"), *shlex.split(replay)[1:], "--out", "replayed"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    replayed, _ = results.read(tmp_path / "replayed")
    assert list(replayed.diagnosers) == ["fdie", "theirs"]
    seen = replayed.signals["theirs.loe_estimate"]
    assert np.array_equal(seen, recording.signals["theirs.loe_estimate"][-len(seen) :])


def test_fdie_runs_in_ecos_from_ten_lines():
    importer("ecospy")
    code = block("python", "import ecospy")
    assert len([line for line in code.splitlines() if line]) <= 11
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "alarm: 1.0"
