"""Loss and delay by the kernel's netem, on a vxcan pair (on vcan netem does nothing: frames are echoed before it)."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import can
import pytest

from rotordx.hil_bridge.buses import BusAddress, open_bus

NEAR, FAR = "vxcan0", "vxcan1"
pytestmark = pytest.mark.skipif(not Path(f"/sys/class/net/{NEAR}").exists(), reason=f"there is no {NEAR}")


@pytest.fixture
def netem():
    """Sets what happens to frames that leave either end."""

    def impair(*what: str) -> None:
        for device in (NEAR, FAR):
            subprocess.run(["tc", "qdisc", "replace", "dev", device, "root", "netem", *what], check=True)

    yield impair
    for device in (NEAR, FAR):
        subprocess.run(["tc", "qdisc", "del", "dev", device, "root"], check=False)


def latencies(frames: int) -> list[float]:
    """Times (s) of the frames that arrive."""
    arrived = []
    near, far = (open_bus(BusAddress.of(f"socketcan:{device}")) for device in (NEAR, FAR))
    with near, far:
        for i in range(frames):
            begin = time.monotonic()
            near.send(can.Message(arbitration_id=i, data=b"12345678"))
            if far.recv(0.1) is not None:
                arrived.append(time.monotonic() - begin)
    return arrived


def test_loss(netem):
    assert len(latencies(100)) == 100
    netem("loss", "30%")
    assert len(latencies(200)) == pytest.approx(140, abs=4 * (200 * 0.3 * 0.7) ** 0.5)


def test_delay(netem):
    netem("delay", "10ms")
    delayed = latencies(30)
    assert len(delayed) == 30
    assert min(delayed) >= 0.0099


def test_a_healthy_flight_over_a_lossy_link_raises_no_alarm(netem, rotordx, tmp_path):
    netem("loss", "5%")
    escs = rotordx("esc", "--bus", f"socketcan:{FAR}")
    assert escs.stderr.readline().startswith("ESC nodes")
    hil = rotordx(
        "hil", "healthy_circle", "--bus", f"socketcan:{NEAR}", "--escs", "running", "--watchdog", "5",
        "--set", "duration_s=2", "--out", "flown",
    )  # fmt: skip
    _, errors = hil.communicate(timeout=120)
    assert hil.returncode == 0, errors
    summary = json.loads((tmp_path / "flown" / "summary.json").read_text())
    assert summary["diagnosers"]["fdie"]["fault_detected"] is False
    assert summary["hil"]["frames"]["lost_answers"] > 0
    assert summary["hil"]["frames"]["lost_commands"] > 0
