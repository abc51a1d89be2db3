"""The load of a bus, planned and measured; a plan that does not fit is refused with the figures."""

from __future__ import annotations

import pytest

from rotordx.hil_bridge.load import Plan, frame_bits, measured_load, plan
from rotordx.orchestrator.errors import UserError


def longest_stuffed_frame(data_bytes: int) -> int:
    """Bits of the worst frame, stuffed bit by bit: after five equal bits comes one of the other kind, which counts."""
    body = 54 + 8 * data_bytes  # start to CRC: 1 + 11 + 1 + 1 + 18 + 1 + 2 + 4 bits, data, 15
    bits, run, last = 0, 0, None
    worst = [0] * 5 + [1, 1, 1, 1, 0, 0, 0, 0] * 20  # 00000(1)1111(0)0000(1)...
    for bit in worst[:body]:
        bits += 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            bits, run, last = bits + 1, 1, 1 - bit
    return bits + 1 + 2 + 7 + 3  # CRC delimiter, acknowledge, end of frame, gap


@pytest.mark.parametrize("data_bytes", range(9))
def test_bits_of_a_frame(data_bytes):
    plain = 1 + 11 + 1 + 1 + 18 + 1 + 2 + 4 + 8 * data_bytes + 15 + 1 + 2 + 7 + 3
    assert frame_bits(data_bytes, stuffed=False) == plain
    assert plain < frame_bits(data_bytes, stuffed=True)
    assert frame_bits(data_bytes, stuffed=True) - longest_stuffed_frame(data_bytes) in (0, 1)  # a stuff bit at the end


def test_the_standard_plan_fits():
    standard = plan(0.002, 100.0, 4, command="raw", emulated=True, bit_rate=1e6)
    assert standard.rates["RawCommand"] == standard.rates["RotorSpeeds"] == 500
    assert standard.rates["Status"] == 400
    commands = 500 * frame_bits(8, stuffed=True)
    status = 400 * (2 * frame_bits(8, stuffed=True) + frame_bits(3, stuffed=True))
    assert standard.share("RawCommand") == pytest.approx(commands / 1e6)
    assert standard.share("Status") == pytest.approx(status / 1e6)
    assert 0.25 < standard.load(stuffed=False) < standard.load() < 0.36
    standard.check()


@pytest.mark.parametrize(("status_rate", "bit_rate"), [(500.0, 1e6), (100.0, 250e3)])
def test_a_plan_above_70_percent_is_refused_with_its_figures(status_rate, bit_rate):
    crowded = plan(0.002, status_rate, 4, command="raw", emulated=True, bit_rate=bit_rate)
    assert crowded.load() > 0.7
    with pytest.raises(UserError, match=r"loaded to \d+ % of .* kbit/s, more than 70 %: RawCommand at 500 Hz .* %"):
        crowded.check()


def test_real_escs_send_no_vendor_frames():
    assert "RotorSpeeds" not in plan(0.002, 100.0, 4, command="rpm", emulated=False, bit_rate=1e6).rates


def test_the_limit_is_exact():
    rate = 0.7e6 / frame_bits(8, stuffed=True)
    Plan({"RawCommand": rate * 0.9999}, 1e6).check()
    with pytest.raises(UserError):
        Plan({"RawCommand": rate * 1.0001}, 1e6).check()


def test_measured_from_frames_seen():
    assert measured_load({8: 500, 3: 100}, 1.0, 1e6, stuffed=False) == pytest.approx((500 * 131 + 100 * 91) / 1e6)
