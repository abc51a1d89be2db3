"""A flight gives the same verdict live and replayed from a log in other axes, units and rotor order."""

from __future__ import annotations

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator import metrics, results
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.logs import read_flight
from rotordx.orchestrator.replay import replay
from rotordx.orchestrator.signal_map import load_signal_map
from tests.replay.conftest import foreign_log_of


@pytest.fixture
def replayed(craft, write_csv, write_map, mapping):
    """Function that replays columns through the test's mapping."""

    def run(columns, **tables):
        signal_map = load_signal_map(write_map(mapping | tables))
        flight = read_flight(write_csv(columns), signal_map, load_vehicle(craft))
        return replay(flight, str(craft), ["fdie"])

    return run


def test_the_live_flight_finds_its_fault(broken_rotor):
    score = metrics.score(broken_rotor, "fdie")
    assert score["false_alarm"] is False
    assert score["faulty_rotor"] == 3
    assert score["loe_estimate"][2] == pytest.approx(0.2, abs=0.03)


def test_a_result_folder_replays_bit_for_bit(broken_rotor, craft, tmp_path):
    results.write_timeseries(broken_rotor, tmp_path / "timeseries.parquet")
    flight = read_flight(tmp_path / "timeseries.parquet", None, load_vehicle(craft))
    assert flight.signal_map.name == "recording"
    again = replay(flight, str(craft), ["fdie"])
    np.testing.assert_array_equal(again.time, broken_rotor.time)
    np.testing.assert_array_equal(again.signals["log.position"], broken_rotor.signals["plant.position"])
    outputs = [key for key in broken_rotor.signals if key.startswith("fdie.")]
    assert len(outputs) > 10
    for key in outputs:
        np.testing.assert_array_equal(again.signals[key], broken_rotor.signals[key], err_msg=key)


def test_a_log_in_other_conventions_gives_the_same_verdict(broken_rotor, replayed, mapping):
    columns = foreign_log_of(broken_rotor)
    order = {"m1": "front_right", "m2": "rear_left", "m3": "front_left", "m4": "rear_right"}
    columns = {order.get(name, name): values for name, values in columns.items()}
    mapping["rotor_speed_command"]["columns"] = list(order.values())
    again = replayed(columns)
    for key in ("residual", "threshold", "isolation_residual", "loe_estimate", "faulty_rotor", "detection_time"):
        np.testing.assert_allclose(
            again.signals[f"fdie.{key}"], broken_rotor.signals[f"fdie.{key}"], atol=1e-6, err_msg=key
        )


@pytest.mark.parametrize(
    ("table", "field", "wrong"),
    [
        ("body_rate", "sign", [-1, -1, -1]),
        ("body_rate", "sign", [1, 1, -1]),
        ("body_rate", "columns", ["gy", "gx", "gz"]),
        ("rotor_speed_command", "columns", ["m2", "m1", "m3", "m4"]),
        ("rotor_speed_command", "columns", ["m1", "m2", "m4", "m3"]),
        ("rotor_speed_command", "unit", "rad/s"),
        ("vertical_velocity", "velocity", {"column": "climb", "unit": "cm/s", "filtered": True}),
    ],
)
def test_a_wrong_sign_order_or_unit_is_seen_by_the_diagnoser(broken_rotor, replayed, mapping, table, field, wrong):
    """Each convention of the mapping matters: with it wrong, residuals or thresholds are others.

    The verdict alone would not tell: the sign of p hardly changes it, because the controller keeps p small and the
    residual of a fault comes from the torque that is commanded against it.
    """
    again = replayed(foreign_log_of(broken_rotor), **{table: mapping[table] | {field: wrong}})
    margin = {key: broken_rotor.signals[f"fdie.{key}"] for key in ("residual", "threshold")}
    relative = abs(again.signals["fdie.residual"] - margin["residual"]) / margin["threshold"]
    assert np.nanmax(relative) > 0.1


def test_two_parts_are_two_flights_and_the_first_verdict_stands(broken_rotor, replayed):
    columns = foreign_log_of(broken_rotor)
    columns["height"] = np.where((broken_rotor.time > 5.0) & (broken_rotor.time < 5.5), 0.0, 1.0)
    airborne = {"column": "height", "above": 0.5}
    again = replayed(columns, airborne=airborne, samples={"shortest_part_s": 3.0})
    parts = again.scenario["replay"]["parts_s"]
    assert [tuple(part) for part in parts] == [pytest.approx((0, 5), abs=0.003), pytest.approx((5.5, 9), abs=0.003)]
    between = (again.time > 5.01) & (again.time < 5.49)
    assert np.isnan(again.signals["log.body_rate"][between]).all()
    assert np.isnan(again.signals["fdie.residual"][between]).all()
    assert np.allclose(np.diff(again.time), 0.002)
    score = metrics.score(again, "fdie")
    assert score["faulty_rotor"] == 3
    assert score["detection_time_s"] == pytest.approx(5.5 + 2.0, abs=0.02)  # on the log's clock, after the warm-up

    columns["height"] = np.where((broken_rotor.time > 7.5) & (broken_rotor.time < 7.9), 0.0, 1.0)
    stands = replayed(columns, airborne=airborne, samples={"shortest_part_s": 1.0})
    live = metrics.score(broken_rotor, "fdie")
    assert metrics.score(stands, "fdie")["detection_time_s"] == pytest.approx(live["detection_time_s"], abs=1e-9)
    end_of_first = np.searchsorted(stands.time, stands.scenario["replay"]["parts_s"][0][1])
    assert (stands.signals["fdie.residual"][end_of_first:] == stands.signals["fdie.residual"][end_of_first]).all()


def test_a_known_loss_is_scored(broken_rotor, craft, write_csv, write_map, mapping):
    late = foreign_log_of(broken_rotor)
    late = {name: values[broken_rotor.time >= 6.0] for name, values in late.items()}
    flight = read_flight(write_csv(late), load_signal_map(write_map(mapping)), load_vehicle(craft))
    score = metrics.score(replay(flight, str(craft), ["fdie"], {3: 0.2}), "fdie")
    assert score["isolation_correct"] is True
    assert score["loe_final_error"] == pytest.approx(0, abs=0.03)


def test_a_log_in_which_a_rotor_does_not_turn_is_refused(broken_rotor, replayed):
    columns = foreign_log_of(broken_rotor)
    columns["m2"] = 0 * columns["m2"]
    with pytest.raises(UserError, match=r"flight\.csv.* rotor 2 was commanded to lift next to nothing"):
        replayed(columns)
