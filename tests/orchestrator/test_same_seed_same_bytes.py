"""A flight is determined by its scenario alone: not by FMI version, by what flew before, or by how it is watched."""

from __future__ import annotations

import numpy as np
import pytest

from rotordx.orchestrator.flight import CHUNK, fly
from rotordx.orchestrator.recording import Recording

COMPONENTS = ("reference", "controller", "esc", "plant", "sensors", "fdie")


def log_bytes(recording: Recording) -> bytes:
    return b"".join(np.ascontiguousarray(values).tobytes() for values in (recording.time, *recording.signals.values()))


@pytest.mark.parametrize(
    "fmi2",
    [COMPONENTS, ("controller", "plant", "fdie"), ("reference", "esc", "sensors")],
    ids=["all FMI 2", "mixed", "mixed the other way"],
)
def test_fmi_2_and_fmi_3_components_mix_and_agree_bit_for_bit(system, short, fmi2):
    mixed = short(components={name: {"fmi": 2} for name in fmi2})
    assert log_bytes(fly(mixed)) == log_bytes(fly(short(), system))


def test_a_system_that_has_flown_before_flies_like_a_fresh_one(system, short):
    fly(short(seed=8, vehicle="crazyflie", parameters={"trajectory": "hover"}), system)
    assert log_bytes(fly(short(), system)) == log_bytes(fly(short()))


def test_another_seed_gives_other_gusts_and_other_noise(system, short):
    one, other = fly(short(), system).signals, fly(short(seed=2), system).signals
    assert not np.array_equal(one["plant.disturbance"], other["plant.disturbance"])
    assert not np.array_equal(one["sensors.body_rate"], other["sensors.body_rate"])
    # the noise of gyro and gusts must not be one stream that both components draw
    gust, gyro = one["plant.disturbance"][1:, 3], one["sensors.body_rate"][1:, 0] - one["plant.body_rate"][1:, 0]
    assert abs(np.corrcoef(gust, gyro)[0, 1]) < 0.3


def test_time_is_the_step_number_times_the_step_size(system, short):
    recording = fly(short(), system)
    assert np.array_equal(recording.time, np.array([k * 0.002 for k in range(501)]))


def test_a_watching_callback_changes_nothing(system, short):
    seen = []
    watched = fly(short(), system, callback=lambda time, signals: seen.append(time), callback_decimation=7)
    assert log_bytes(watched) == log_bytes(fly(short(), system))
    assert seen == [k * 0.002 for k in range(0, 500, 7)]


@pytest.mark.parametrize("log_every", [2, 7, CHUNK + 1])
def test_a_decimated_log_holds_every_nth_row(system, short, log_every):
    scenario = short(duration_s=3.0)
    full, decimated = fly(scenario, system), fly(scenario, system, log_every=log_every)
    assert np.array_equal(decimated.time, full.time[::log_every])
    for key, values in full.signals.items():
        assert np.array_equal(decimated.signals[key], values[::log_every], equal_nan=True), key
