"""A log reaches the diagnosers in their units, axes and instants, and an unusable one is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.logs import read_flight
from rotordx.orchestrator.signal_map import load_signal_map
from tests.replay.conftest import foreign_log

VEHICLE = load_vehicle("lab_x")
STEP = 0.002


@pytest.fixture
def read(write_csv, write_map, mapping):
    """Function that reads columns through the test's mapping."""

    def read_columns(columns, **tables):
        for table, fields in tables.items():
            mapping[table] = mapping.get(table, {}) | fields
        return read_flight(write_csv(columns), load_signal_map(write_map(mapping)), VEHICLE)

    return read_columns


def irregular_time(duration=6.0, period=0.0099):
    jitter = np.random.default_rng(1).uniform(-0.002, 0.002, round(duration / period))
    return 100.0 + period * np.arange(len(jitter)) + np.where(np.arange(len(jitter)) > 0, jitter, 0)


# Instants, units, axes


def test_measurements_are_converted_and_interpolated_linearly(read):
    time = irregular_time()
    slopes = np.array([0.1, -0.2, 0.3])
    ramp = np.outer(time - time[0], slopes)
    flight = read(foreign_log(time, body_rate=ramp, euler=0.5 * ramp, vertical_velocity=ramp[:, 2]))
    (part,) = flight.parts
    assert part.time == pytest.approx(STEP * np.arange(len(part.time)), abs=1e-12)
    assert part.time[-1] == pytest.approx(time[-1] - time[0], abs=STEP)
    assert part.step_size == pytest.approx(STEP)
    expected = np.outer(part.time, slopes)
    np.testing.assert_allclose(part.body_rate, expected, atol=1e-9)
    np.testing.assert_allclose(part.euler, 0.5 * expected, atol=1e-9)
    np.testing.assert_allclose(part.vertical_velocity, expected[:, 2], atol=1e-9)
    np.testing.assert_allclose(part.rotor_speed_command, 500.0, rtol=1e-12)
    np.testing.assert_array_equal(part.inputs[:, 7:10], part.body_rate)


def test_an_angle_is_interpolated_the_shorter_way_round(read):
    time = irregular_time()
    yaw = 1.3 * (time - time[0])
    wrapped = np.stack([0 * yaw, 0 * yaw, (yaw + np.pi) % (2 * np.pi) - np.pi], axis=1)
    (part,) = read(foreign_log(time, euler=wrapped)).parts
    assert np.ptp(wrapped[:, 2]) < 2 * np.pi < yaw[-1]
    np.testing.assert_allclose(part.euler[:, 2], 1.3 * part.time, atol=1e-9)


def test_a_delayed_measurement_is_taken_from_later_rows(read):
    time = irregular_time()
    ramp = np.outer(time - time[0], [1.0, 1.0, 1.0])
    (part,) = read(foreign_log(time, body_rate=ramp, euler=ramp), body_rate={"delay_s": 0.03}).parts
    inside = part.time < part.time[-1] - 0.04
    np.testing.assert_allclose(part.body_rate[inside, 0], part.time[inside] + 0.03, atol=1e-9)
    np.testing.assert_allclose(part.euler[inside, 0], part.time[inside], atol=1e-9)


@pytest.mark.parametrize(("delay", "row"), [(0.0, 1), (0.004, 3), (-STEP, 0)])
def test_a_sample_has_the_command_that_acted_over_the_step_that_ends_there(read, delay, row):
    time = STEP * np.arange(2000)
    command = np.tile(400.0 + np.arange(2000)[:, None], 4)
    (part,) = read(foreign_log(time, rotor_speed_command=command), rotor_speed_command={"delay_s": delay}).parts
    k = np.arange(10, 1990)
    np.testing.assert_allclose(part.rotor_speed_command[k, 2], 400.0 + k - row, rtol=1e-12)


def test_commands_are_held_between_rows(read):
    time = 0.01 * np.arange(400)
    command = np.tile(400.0 + np.arange(400)[:, None], 4)
    (part,) = read(foreign_log(time, rotor_speed_command=command)).parts
    k = np.arange(1, len(part.time))
    np.testing.assert_allclose(part.rotor_speed_command[1:, 0], 400 + (k - 1) // 5, rtol=1e-12)


def test_thrust_commands_are_mixed_clipped_and_proportional_to_the_squared_speed(read, mapping):
    time = irregular_time()
    columns = foreign_log(time) | {
        "T": np.full(len(time), 40000.0),
        "r": np.full(len(time), 3000.0),
        "p": np.full(len(time), -2000.0),
        "y": np.full(len(time), 30000.0),
    }
    crazypad = load_signal_map("crazypad").rotor_speed_command
    mapping["rotor_speed_command"] = {
        "kind": "thrust_proportional",
        "columns": ["T", "r", "p", "y"],
        "mixer": [list(row) for row in crazypad.mixer],
        "clip": list(crazypad.clip),
        "full_scale": crazypad.full_scale,
    }
    (part,) = read(columns).parts
    thrust, roll, pitch, yaw = 40000, 3000 / 2, -2000 / 2, 30000
    motors = [
        thrust - roll + pitch + yaw,
        thrust - roll - pitch - yaw,
        thrust + roll - pitch + yaw,
        thrust + roll + pitch - yaw,
    ]
    assert max(motors) > 65535  # rotors 1 and 3 saturate
    relative = (part.rotor_speed_command[0] / VEHICLE.parameters["rotor_speed_max"]) ** 2
    np.testing.assert_allclose(relative, np.clip(motors, 0, 65535) / 65535, rtol=1e-12)


# Signals that are derived


def vertical_motion(time, rate=3.0):
    """Height (m, up), velocity (m/s, down) and acceleration (m/s2, down) of a vertical sine."""
    return 0.3 * np.sin(rate * time), -0.3 * rate * np.cos(rate * time), 0.3 * rate**2 * np.sin(rate * time)


def filtered_velocity(time, rate=3.0, bandwidth=20.0):
    """Steady response of F = w0^2 / (s + w0)^2 to that velocity, from the filter's complex gain."""
    gain = bandwidth**2 / (1j * rate + bandwidth) ** 2
    return (-0.3 * rate * gain * np.exp(1j * rate * time)).real


@pytest.mark.parametrize(
    "source",
    [
        {"velocity": {"column": "climb", "unit": "cm/s", "sign": -1}},
        {"altitude": {"column": "z", "unit": "cm"}},
        {
            "altitude": {"column": "z", "unit": "cm"},
            "specific_force": {"column": "acc", "unit": "g"},
            "crossover_rad_s": 2.0,
        },
    ],
    ids=["velocity", "altitude", "altitude and acceleration"],
)
def test_vertical_velocity_passes_the_filter_of_the_diagnosers(read, mapping, source):
    time = 0.005 * np.arange(4000)
    height, velocity, acceleration = vertical_motion(time)
    columns = foreign_log(time, vertical_velocity=velocity) | {
        "z": 100 * height,
        "acc": (9.81 - acceleration) / 9.80665,
    }
    mapping["vertical_velocity"] = source
    (part,) = read(columns).parts
    settled = part.time > 8.0
    np.testing.assert_allclose(part.vertical_velocity[settled], filtered_velocity(part.time)[settled], atol=2e-3)


def test_noise_of_the_altitude_is_kept_out_and_a_bias_of_the_accelerometer_does_no_harm(read, mapping):
    time = 0.005 * np.arange(6000)
    noise = np.random.default_rng(2).normal(0, 0.002, len(time))
    columns = foreign_log(time) | {"z": noise, "acc": np.full(len(time), 1.0 + 0.02)}
    altitude = {"column": "z", "unit": "m"}
    acceleration = {"column": "acc", "unit": "g"}
    mapping["vertical_velocity"] = {"altitude": altitude}
    (alone,) = read(columns).parts
    mapping["vertical_velocity"] = {
        "altitude": altitude,
        "specific_force": acceleration,
        "crossover_rad_s": 2.0,
    }
    (fused,) = read(columns).parts
    settled = fused.time > 10.0
    assert fused.vertical_velocity[settled].std() < 0.15 * alone.vertical_velocity[settled].std()
    bias = 9.81 - 1.02 * 9.80665
    assert fused.vertical_velocity[settled].mean() == pytest.approx(2 / 2.0 * bias, rel=0.02)


def test_specific_force_is_taken_along_the_tilted_axis(read, mapping):
    """In level flight at a constant tilt the accelerometer shows 1 / (cos(roll) cos(pitch)) g."""
    time = 0.005 * np.arange(4000)
    tilt = np.tile([0.3, -0.2, 1.0], (len(time), 1))
    shown = np.full(len(time), 9.81 / 9.80665 / np.cos(0.3) / np.cos(0.2))
    mapping["vertical_velocity"] = {
        "altitude": {"column": "z", "unit": "m"},
        "specific_force": {"column": "acc", "unit": "g"},
        "crossover_rad_s": 1.0,
    }
    (part,) = read(foreign_log(time, euler=tilt) | {"z": 0 * time, "acc": shown}).parts
    assert np.abs(part.vertical_velocity).max() < 1e-6


def test_roll_and_pitch_are_integrated_where_no_attitude_was_logged(read, mapping):
    time = 0.005 * np.arange(2000)
    rate = np.stack([0.4 * np.cos(2 * time), -0.2 * np.cos(2 * time), 1.0 + 0 * time], axis=1)
    mapping["euler"] = {"source": "integrated_body_rate", "forgetting_time_s": 100.0}
    (part,) = read(foreign_log(time, body_rate=rate)).parts
    # from the steady state of the first value: 100 s times the rate
    drift = np.exp(-part.time / 100.0)[:, None] * 100.0 * rate[:1, :2]
    swing = 0.5 * np.sin(2 * part.time)[:, None] * rate[:1, :2]
    np.testing.assert_allclose(part.euler[:, :2] - drift, swing, atol=0.01)
    assert not part.euler[:, 2].any()


def test_the_position_is_taken_along_where_it_was_logged(read, mapping):
    time = irregular_time()
    path = np.outer(time - time[0], [1.0, 2.0, -3.0])
    columns = foreign_log(time) | {"east": 100 * path[:, 1], "north": 100 * path[:, 0], "up": -100 * path[:, 2]}
    mapping["position"] = {"columns": ["north", "east", "up"], "sign": [1, 1, -1], "unit": "cm"}
    flight = read(columns)
    np.testing.assert_allclose(flight.positions[0], np.outer(flight.parts[0].time, [1.0, 2.0, -3.0]), atol=1e-9)
    del columns["north"]
    assert read(columns).positions is None


# Parts


def test_only_airborne_parts_are_kept_less_their_margins(read):
    time = 0.01 * np.arange(2001)
    height = np.where((time > 2) & (time < 8), 1.0, 0.0) + np.where((time > 12) & (time < 19), 1.0, 0.0)
    flight = read(
        foreign_log(time) | {"height": height},
        airborne={"column": "height", "above": 0.5, "margin_start_s": 1.0, "margin_end_s": 0.5},
    )
    assert [(p.time[0], p.time[-1]) for p in flight.parts] == [
        pytest.approx((3.0, 7.5), abs=0.012),
        pytest.approx((13.0, 18.5), abs=0.012),
    ]


def test_small_gaps_are_bridged_and_large_ones_end_the_part(read):
    time = 0.01 * np.arange(2001)
    kept = ~((time > 5.0) & (time < 5.04)) & ~((time > 10.0) & (time < 10.2))
    flight = read(foreign_log(time[kept]))
    assert [(p.time[0], p.time[-1]) for p in flight.parts] == [
        pytest.approx((0.0, 10.0), abs=0.0021),
        pytest.approx((10.2, 20.0), abs=0.0021),
    ]
    assert flight.notes == ["0.2 s without rows at 10.00 s"]


def test_short_parts_are_left_out_with_a_note(read):
    time = 0.01 * np.arange(2001)
    height = (time < 1.0) | (time > 5.0)
    flight = read(foreign_log(time) | {"height": 1.0 * height}, airborne={"column": "height", "above": 0.5})
    assert len(flight.parts) == 1
    assert flight.notes == ["1 airborne part(s) shorter than 3 s were left out"]


def test_incomplete_rows_are_skipped_only_if_the_mapping_says_so(read):
    time = irregular_time()
    columns = foreign_log(time)
    columns["gy"] = columns["gy"].copy()
    columns["gy"][[7, 30]] = np.nan, np.inf
    with pytest.raises(UserError, match=r"flight\.csv: column `gy`, row 8: empty or not finite.*skip_incomplete_rows"):
        read(columns)
    flight = read(columns, samples={"skip_incomplete_rows": True})
    assert flight.notes == ["2 incomplete rows were skipped"]
    assert np.isfinite(flight.parts[0].inputs).all()


def test_parquet_is_read_like_csv(write_map, write_csv, mapping, tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    columns = foreign_log(irregular_time(), body_rate=np.random.default_rng(3).normal(size=(606, 3)))
    signal_map = load_signal_map(write_map(mapping))
    parquet.write_table(pa.table(columns), tmp_path / "flight.parquet")
    from_csv = read_flight(write_csv(columns), signal_map, VEHICLE)
    from_parquet = read_flight(tmp_path / "flight.parquet", signal_map, VEHICLE)
    np.testing.assert_array_equal(from_parquet.parts[0].inputs, from_csv.parts[0].inputs)


# Logs that cannot be used


def corrupt(columns, name, row, value):
    cells = [str(cell) for cell in columns[name]]
    cells[row] = value
    return columns | {name: cells}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {k: v for k, v in c.items() if k != "gz"}, "has no column `gz`, which the signal mapping `foreign`"),
        (lambda c: corrupt(c, "m3", 4, "off"), "column `m3`, row 5: 'off' is no number"),
        (lambda c: corrupt(c, "roll", 9, ""), "column `roll`, row 10: empty or not finite"),
        (lambda c: corrupt(c, "climb", 2, "inf"), "column `climb`, row 3: empty or not finite"),
        (lambda c: corrupt(c, "t_ms", 9, str(c["t_ms"][8])), "time does not increase from row 9 .* to row 10"),
        (lambda c: corrupt(c, "t_ms", 5, "0"), "time does not increase from row 5 .* to row 6 .*sort the rows"),
        (lambda c: c | {"t_ms": 1e7 * (c["t_ms"] - c["t_ms"][0])}, "correct the unit of .time."),
        (lambda c: {k: v[:0] for k, v in c.items()}, "has no rows; give a log"),
        (lambda c: {k: v[:1] for k, v in c.items()}, "has 1 complete row"),
        (lambda c: {k: v[:50] for k, v in c.items()}, "no airborne part of at least 3 s is left"),
    ],
)
def test_unusable_logs_are_refused_by_file_column_and_row(read, change, message):
    with pytest.raises(UserError, match=message) as refused:
        read(change(foreign_log(irregular_time())))
    assert "flight.csv: " in str(refused.value)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_damaged_files_are_refused_by_name(tmp_path, write_map, write_csv, mapping, suffix):
    import pyarrow as pa
    from pyarrow import parquet

    signal_map = load_signal_map(write_map(mapping))
    columns = foreign_log(irregular_time())
    path = tmp_path / f"flight.{suffix}"
    if suffix == "csv":
        write_csv(columns)
    else:
        parquet.write_table(pa.table(columns), path)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(UserError, match=rf"flight\.{suffix}: is no complete .* log: .*cut off"):
        read_flight(path, signal_map, VEHICLE)
    path.write_bytes(b"")
    with pytest.raises(UserError, match=rf"flight\.{suffix}: is no complete .* log: .*give a CSV file"):
        read_flight(path, signal_map, VEHICLE)
    path.unlink()
    with pytest.raises(UserError, match=rf"flight\.{suffix}: cannot be read: .*give the path of a flight log"):
        read_flight(path, signal_map, VEHICLE)
