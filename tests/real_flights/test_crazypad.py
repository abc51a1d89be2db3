"""On real flights of a Crazyflie: no alarm in health, an alarm with a cut propeller, and nobody else blamed for it."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator import metrics
from rotordx.orchestrator.identification import identify
from rotordx.orchestrator.replay import MEAN_LOSS, replay
from tests.real_flights.conftest import CUT, HEALTHY

ROTOR = 3  #: the one whose propeller was cut, in the craft's own numbers


@pytest.fixture(scope="module")
def verdict(flights, craft):
    """Function that gives the score of fdie on a log."""

    def of(name, vehicle=craft):
        return metrics.score(replay(flights[name], str(vehicle), ["fdie"]), "fdie")

    return of


def test_every_log_has_two_airborne_parts(flights):
    for flight in flights.values():
        assert len(flight.parts) == 2
        assert all(5.0 < part.time[-1] - part.time[0] < 6.5 for part in flight.parts)
        assert all(np.isfinite(part.inputs).all() for part in flight.parts)


def test_the_identified_trim_is_that_of_the_logged_commands(crazypad, flights, craft):
    """Second opinion without any of our code: in hover a rotor's effectiveness is inverse to its mean command."""
    means = []
    for name in HEALTHY:
        with (crazypad / f"{name}.csv").open() as stream:
            rows = list(csv.DictReader(stream))
        start = float(rows[0]["t_s"])
        for part in flights[name].parts:
            airborne = [r for r in rows if part.time[0] <= float(r["t_s"]) - start <= part.time[-1]]
            columns = ("cmd_thrust", "cmd_roll", "cmd_pitch", "cmd_yaw")
            t, r, p, y = np.array([[float(row[column]) for column in columns] for row in airborne]).T
            r, p = r / 2, p / 2
            means.append([m.mean() for m in (t - r + p + y, t - r - p - y, t + r - p + y, t + r + p - y)])
    expected = 1 / np.mean(means, axis=0)
    thrust = np.array(load_vehicle(craft).parameters["thrust_coefficient"])
    np.testing.assert_allclose(thrust / thrust.mean(), expected / expected.mean(), atol=0.01)


@pytest.mark.parametrize("name", HEALTHY)
def test_healthy_flights_raise_no_alarm(verdict, name):
    assert not verdict(name)["fault_detected"]


@pytest.mark.parametrize("left_out", HEALTHY)
def test_a_healthy_flight_that_was_not_identified_from_raises_no_alarm(flights, verdict, tmp_path, left_out):
    others = [part for name in HEALTHY if name != left_out for part in flights[name].parts]
    craft = identify(others, load_vehicle("crazyflie"), tmp_path / "craft.toml").files[0]
    assert not verdict(left_out, craft)["fault_detected"]


@pytest.mark.parametrize("name", CUT)
def test_a_cut_propeller_is_noticed_and_no_other_rotor_is_blamed(verdict, name):
    score = verdict(name)
    assert score["fault_detected"]
    assert score["faulty_rotor"] in (ROTOR, 0, -1)


@pytest.mark.parametrize("name", [name for name, loss in CUT.items() if loss >= 0.1])
def test_a_loss_of_10_percent_and_more_is_named_and_sized(verdict, name):
    score = verdict(name)
    assert score["faulty_rotor"] == ROTOR
    assert score["loe_estimate"][ROTOR - 1] == pytest.approx(CUT[name], abs=0.03)


@pytest.mark.parametrize("name", CUT)
def test_the_mean_balance_has_sign_and_size_of_the_loss(flights, craft, name):
    losses = replay(flights[name], str(craft), ["fdie"]).scenario["replay"][MEAN_LOSS]
    assert losses[ROTOR - 1] == pytest.approx(CUT[name], abs=0.015)
    assert np.argmax(losses) == ROTOR - 1
    assert losses[1] < -0.03  # rotor 2 had changed since the healthy flights
