"""A flight in real time: nothing is lost, and the timing report says how well the time was kept."""

from __future__ import annotations

import json

from rotordx.orchestrator import results


def test_no_frame_is_lost(bus, rotordx, tmp_path):
    hil = rotordx("hil", "hover", "--bus", bus, "--fifo", "--set", "duration_s=4", "--watchdog", "5", "--out", "flown")
    output, errors = hil.communicate(timeout=120)
    assert hil.returncode == 0, errors
    recording, _ = results.read(tmp_path / "flown")
    hil_figures = json.loads((tmp_path / "flown" / "summary.json").read_text())["hil"]
    frames = hil_figures["frames"]
    assert (frames["lost_answers"], frames["lost_commands"], frames["lost_status"], frames["broken"]) == (0, 0, 0, 0)
    assert hil_figures["ticks"] == len(recording.time) - 1 == 2000
    assert set(hil_figures["lateness_s"]) == {"p50", "p99", "p99.9", "max"}
    assert 0 <= hil_figures["missed_ticks"] <= 2000
    assert len(hil_figures["machine"]["load_average"]) == 3
    assert abs(hil_figures["bus_load"]["measured"] - hil_figures["bus_load"]["planned"]) < 0.02
    assert "lateness p50" in output
