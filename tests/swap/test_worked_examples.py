"""The examples of the orchestrator's README work as printed: another tool's controller here, fdie in another tool."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

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


def test_a_controller_made_with_pythonfmu3_flies(tmp_path):
    importer("pythonfmu3")
    (tmp_path / "hover.py").write_text(block("python", "# hover.py"))
    (tmp_path / "hover.toml").write_text(block("toml", "# hover.toml"))
    build = [sys.executable, "-m", "pythonfmu3", "build", "-f", "hover.py"]
    subprocess.run(build, cwd=tmp_path, check=True, capture_output=True)
    flown = fly(load_scenario(tmp_path / "hover.toml")).signals
    assert flown["controller.rotor_speed_command"].shape == (4001, 4)
    np.testing.assert_allclose(flown["plant.position"][-1], [0.0, 0.0, -2.5], atol=0.02)


def test_fdie_runs_in_ecos_from_ten_lines():
    importer("ecospy")
    code = block("python", "import ecospy")
    assert len([line for line in code.splitlines() if line]) <= 11
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "alarm: 1.0"
