"""Our bridge as flight controller of ESCs that are pydronecan nodes, as it would be of real ones."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

from rotordx.orchestrator import results


def test_hover_on_status_alone(bus, theirs, start, rotordx, tmp_path):
    escs = start(sys.executable, str(Path(__file__).parent / "pydronecan_escs.py"), theirs)
    assert escs.stdout.readline() == "ready\n"
    hil = rotordx(
        "hil", "hover", "--bus", bus, "--escs", "real", "--out", "flown", "--watchdog", "5", "--set", "duration_s=2",
        "--status-rate", "50",
    )  # fmt: skip
    output, errors = hil.communicate(timeout=120)
    assert hil.returncode == 0, errors
    assert "ESCs real, rotor speeds of Status are held between updates" in output
    recording, _ = results.read(tmp_path / "flown")
    hil_figures = json.loads((tmp_path / "flown" / "summary.json").read_text())["hil"]
    assert hil_figures["verdict"] == "complete"
    assert hil_figures["frames"]["broken"] == 0
    rpm, age = recording.signals["bus.rpm"][1:], recording.signals["bus.status_age"][1:]
    assert np.isfinite(rpm).all()
    assert (age >= 0).all()
    assert np.allclose(recording.signals["esc.rotor_speed"][1:], rpm * np.pi / 30)
    assert len(np.unique(rpm)) > 8  # held between updates, but they come
