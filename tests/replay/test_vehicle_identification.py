"""Healthy flights give back the rotor trim and the noise they were flown with, as files that a replay can use."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.gains import fdie
from rotordx.gains.design import Design
from rotordx.gains.flight_identification import (
    gyro_noise_std,
    identify_trim,
    identify_vehicle,
    position_noise_std,
    vehicle_file,
)
from rotordx.gains.held_out import held_out_ratio, peak_ratio
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.healthy_flights import flight_of
from rotordx.orchestrator.identification import identify
from rotordx.orchestrator.logs import LoggedFlight
from rotordx.orchestrator.replay import replay
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.signal_map import load_signal_map
from tests.replay.conftest import cut

LAB_X = load_vehicle("lab_x")
TRIM = np.array([0.93, 1.06, 1.02, 0.97])


def with_trim(vehicle, trim):
    scaled = {
        name: tuple(np.array(vehicle.parameters[name]) * trim) for name in ("thrust_coefficient", "torque_coefficient")
    }
    return dataclasses.replace(vehicle, parameters=vehicle.parameters | scaled)


@pytest.fixture(scope="module")
def flights():
    """Two healthy flights of a lab_x with unequal rotors, which its controller does not know."""
    actual = with_trim(LAB_X, TRIM)
    scenarios = [load_scenario("healthy_circle", seed=seed, duration_s=20.0) for seed in (21, 22)]
    recordings = [fly(scenario, actual_vehicle=actual) for scenario in scenarios]
    return [cut(flight_of(recording, "circle"), 2.0) for recording in recordings]


def test_a_known_trim_is_recovered(flights):
    trim = identify_trim(flights, LAB_X)
    np.testing.assert_allclose(trim.effectiveness, TRIM, atol=0.01)
    np.testing.assert_allclose(trim.of_each_flight, [TRIM, TRIM], atol=0.015)
    assert (trim.repeatability < 0.01).all()


def test_motor_lag_and_velocity_filter_do_not_bias_the_trim_of_a_part_cut_out_of_a_manoeuvre():
    calm = {"sensor_noise": False, "gusts": False, "duration_s": 8.0}
    flight = flight_of(fly(load_scenario("vertical_sine", **calm), actual_vehicle=with_trim(LAB_X, TRIM)), "sine")
    parts = [cut(flight, start, start + 1.88) for start in (4.0, 4.6, 5.2)]  # three quarters of a period
    np.testing.assert_allclose(identify_trim(parts, LAB_X).of_each_flight, [TRIM] * 3, atol=0.003)


def test_of_the_identified_vehicle_nothing_is_left_to_trim(flights):
    vehicle, trim = identify_vehicle(flights, LAB_X, "specimen")
    np.testing.assert_allclose(identify_trim(flights, vehicle).effectiveness, 1.0, atol=1e-4)
    for name in ("thrust_coefficient", "torque_coefficient"):
        expected = np.array(LAB_X.parameters[name]) * trim.effectiveness
        np.testing.assert_allclose(vehicle.parameters[name], expected, rtol=1e-4)


def test_noise_is_recovered(flights):
    assert gyro_noise_std(flights) == pytest.approx(LAB_X.parameters["gyro_noise_std"], rel=0.15)
    expected = LAB_X.parameters["motion_capture_position_noise_std"]
    assert position_noise_std(flights, LAB_X) == pytest.approx(expected, rel=0.15)


def test_a_vehicle_file_says_what_was_identified(flights, tmp_path):
    vehicle, trim = identify_vehicle(flights, LAB_X, "specimen")
    path = tmp_path / "specimen.toml"
    path.write_text(vehicle_file(vehicle, "lab_x", trim, flights))
    assert load_vehicle(path).parameters == vehicle.parameters
    text = path.read_text()
    assert f"circle, {flights[0].time[-1] - flights[0].time[0]:.2f} s" in text
    assert all("#" in line for line in text.splitlines() if "= " in line and not line.startswith(("desc", "base")))


@pytest.fixture(scope="module")
def specimen(flights, tmp_path_factory):
    """Vehicle file of that craft, with designs."""
    out = tmp_path_factory.mktemp("identified") / "new" / "specimen.toml"
    assert identify(flights, LAB_X, out).files == [out, out.parent / "designs" / "specimen" / "fdie.json"]
    return out


def test_vehicle_and_designs_lie_where_a_replay_looks_for_them(specimen):
    design = load_design(load_vehicle(specimen), "fdie")
    assert design["vehicle"] == "specimen"
    assert len(design["identified_from"]["flights"]) == 2
    assert not list(specimen.parent.glob(".*"))


def test_bounds_hold_on_a_flight_for_the_design_identified_without_it(flights, specimen):
    factor = load_design(load_vehicle(specimen), "fdie")["identified_from"]["bound_factor"]
    ratio = held_out_ratio(fdie.identify, flights, LAB_X)
    assert factor == pytest.approx(fdie.BOUND_FACTOR * max(1.0, ratio), abs=1e-3)
    vehicle, _ = identify_vehicle(flights[:1], LAB_X, "first")
    widened = fdie.identify(flights[:1], vehicle, bound_factor=2 * factor)
    assert peak_ratio(widened, vehicle, flights[1]) < peak_ratio(
        fdie.identify(flights[:1], vehicle), vehicle, flights[1]
    )


def test_the_peak_ratio_is_that_of_the_fmu_after_its_warm_up(flights, specimen, write_map, mapping):
    vehicle = load_vehicle(specimen)
    design = Design(**load_design(vehicle, "fdie"))
    shaken = flights[0].body_rate + np.where(flights[0].time < flights[0].time[0] + 0.5, 1.0, 0.0)[:, None]
    flight = dataclasses.replace(flights[0], body_rate=shaken)
    logged = LoggedFlight(Path("flight.csv"), load_signal_map(write_map(mapping)), 0.002, [flight], None, [])
    signals = replay(logged, str(specimen), ["fdie"]).signals
    residual, threshold = np.abs(signals["fdie.residual"][1:]), signals["fdie.threshold"][1:]
    assert residual[:999].max() > np.nanmax(threshold)  # while warming up, when no threshold is in force
    assert peak_ratio(design, vehicle, flight) == pytest.approx(np.nanmax(residual / threshold), rel=1e-3)


def test_a_base_given_by_path_is_named_relative_to_the_file(flights, specimen, tmp_path):
    second = identify(flights[:1], load_vehicle(specimen), tmp_path / "second.toml").files[0]
    assert f'base = "{Path(os.path.relpath(specimen, tmp_path)).as_posix()}"' in second.read_text()
    assert load_vehicle(second).files[1].resolve() == specimen.resolve()


def test_impossible_requests_are_refused(flights, specimen, tmp_path):
    with pytest.raises(UserError, match=r"a vehicle file ends in \.toml"):
        identify(flights, LAB_X, tmp_path / "specimen")
    with pytest.raises(UserError, match="is the base vehicle itself"):
        identify(flights, load_vehicle(specimen), specimen)
    standing = [dataclasses.replace(f, rotor_speed_command=0 * f.rotor_speed_command + 1) for f in flights]
    with pytest.raises(UserError, match=r"no vehicle can be identified: .*second\.toml: .*thrust_coefficient"):
        identify(standing, LAB_X, tmp_path / "second.toml")
    with pytest.raises(UserError, match=r"lasts only 0\.40 s; fly longer"):
        identify([cut(flights[0], 2.0, 2.399)], LAB_X, tmp_path / "second.toml")
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"third\.toml cannot be written"):
        identify(flights, LAB_X, tmp_path / "file" / "third.toml")
    assert {path.name for path in tmp_path.iterdir()} == {"file"}
