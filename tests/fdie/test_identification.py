"""Bounds come from healthy flights as `gains/fdie.py` says: offsets, envelopes, exact noise floors, the same bytes."""

import json

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains import fdie
from rotordx.gains.design import write_design
from rotordx.gains.flights import Flight
from tests.fdie.world import DT, FILTER_BANDWIDTH, Diagnosers, World

#: on one worker, because the flights are flown once for all tests
pytestmark = pytest.mark.xdist_group("fdie-identification")
LAB_X = load_vehicle("lab_x")
OFFSET = np.array([0.1, -0.3, 0.2, 0.05])
BOUND = {
    "bound_constant": np.array([0.3, 0.9, 0.7, 0.2]),
    "bound_slope": np.zeros(4),
    "bound_transient_slope": np.zeros(4),
}
SAMPLES = 5000
WHOLE_PERIODS = 2 * np.pi * np.array([2, 3, 2, 4]) / 8  # in the 8 s after the warm-up, so that their mean is 0


def healthy_flights(count=2):
    """Flights without a loss whose uncertainty is a sine as large as the bound allows."""
    none = np.zeros(count, int)
    world = World(count, 4, np.full(count, np.inf), none, np.zeros(count), OFFSET, BOUND)
    rows = []
    for k in range(SAMPLES):
        if k:
            world.advance(np.sin(WHOLE_PERIODS * world.time + np.arange(count)[:, None]))
        rows.append(np.hstack([np.full((count, 1), world.time), world.command, world.euler, world.zeta]))
    history = np.array(rows)
    return [
        Flight(f"flight {i}", h[:, 0], h[:, 1:5], h[:, 5:8], h[:, 9:12], h[:, 8])
        for i, h in enumerate(np.moveaxis(history, 1, 0))
    ]


@pytest.fixture(scope="module")
def flights():
    return healthy_flights()


@pytest.fixture(scope="module")
def design(flights):
    return fdie.identify(flights, LAB_X)


def test_offsets_are_found(design):
    np.testing.assert_allclose(design.parameters["offset"], OFFSET, atol=0.01)


def test_the_bound_is_the_envelope_times_its_factor(design, flights):
    """The amplitude behind the detection filter, with slopes where they make the envelope lower on average."""
    at_rest = np.array(design.parameters["bound_constant"])
    slopes = np.array([design.parameters[name] for name in ("bound_slope", "bound_transient_slope")])
    assert (slopes >= 0).all()
    assert (fdie.BOUND_FACTOR * np.array(fdie.LARGEST_SLOPES) + 1e-12 >= slopes.T).all()
    assert (at_rest <= 1.3 * fdie.BOUND_FACTOR * BOUND["bound_constant"]).all()
    assert (at_rest >= fdie.BOUND_FACTOR * fdie.SMALLEST_CONSTANT).all()


def test_identified_thresholds_hold_with_the_margin_of_the_factor(diagnoser, design, flights):
    """On the flights themselves, smoothing apart, |epsilon| stays below 1/1.25 of the threshold."""
    for flight in flights:
        silent = {name: np.zeros(4) for name in ("detection_noise_floor", "isolation_noise_floor")}
        parameters = {k: np.array(v) if isinstance(v, list) else v for k, v in design.parameters.items()}
        diagnosers = Diagnosers(1, diagnoser, **parameters | silent)
        ratios = []
        for k, time in enumerate(flight.time):
            zeta = np.array([[flight.vertical_velocity[k], *flight.body_rate[k]]])
            outputs = diagnosers.sample(time, flight.rotor_speed_command[k][None], flight.euler[k][None], zeta)
            ratios.append(abs(outputs["residual"][0]) / outputs["threshold"][0])
        assert np.max(ratios[1000:]) <= 1.02 / fdie.BOUND_FACTOR
        assert np.max(ratios[1000:]) >= 0.9 / fdie.BOUND_FACTOR  # and not by far


def test_noise_floors_are_4_5_standard_deviations_of_the_filtered_noise():
    """Against the noise itself: half a million samples through separately discretised filters."""
    rng = np.random.default_rng(1)
    gains = np.array([5.0, 8.0, 15.0, 5.0])
    floors = fdie.noise_floor(gains, LAB_X, DT)
    differentiate = [1 / DT, -1 / DT]
    for gain, floor in zip(gains[1:], floors[1:], strict=True):
        rate = lfilter(differentiate, [1], 0.02 * rng.standard_normal(500_000))
        assert 4.5 * residual_of(rate, gain)[5000:].std() == pytest.approx(floor, rel=0.02)
    position = np.repeat(0.002 * rng.standard_normal(100_000), 5)  # captured at 100 Hz, held
    w = FILTER_BANDWIDTH
    b, a, _ = cont2discrete(([w * w, 0], [1, 2 * w, w * w]), DT, method="zoh")
    residual = residual_of(lfilter(differentiate, [1], lfilter(b[0], a, position)), gains[0])
    of_worst_phase = max(residual[5000 + phase :: 5].std() for phase in range(5))
    assert 4.5 * of_worst_phase == pytest.approx(floors[0], rel=0.03)


def residual_of(rate, gain):
    b, a, _ = cont2discrete(([1], [1, gain]), DT, method="zoh")
    return lfilter([b[0][1]], a, rate)


def test_the_same_flights_give_the_same_bytes(design, flights, tmp_path):
    first = write_design(design, tmp_path / "one")
    second = write_design(fdie.identify(flights, LAB_X), tmp_path / "two")
    assert first == tmp_path / "one" / "lab_x" / "fdie.json"
    assert first.read_bytes() == second.read_bytes()
    content = json.loads(first.read_text())
    assert [f["flight"] for f in content["identified_from"]["flights"]] == ["flight 0", "flight 1"]
    assert len(content["identified_from"]["vehicle_sha256"]) == 64


def test_chosen_gains_enter_the_design(flights):
    design = fdie.identify(flights, LAB_X, {"observer_gain": (6, 9, 9, 6), "loe_max": 0.4})
    assert design.parameters["observer_gain"] == [6, 9, 9, 6]
    assert design.parameters["loe_max"] == 0.4
    np.testing.assert_allclose(design.parameters["offset"], OFFSET, atol=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda flights: [], "there is none; give at least one"),
        (lambda flights: [part(flights[0], slice(0, 900))], "flight 0 is not longer than the warm-up time of 2 s"),
        (lambda flights: [flights[0], part(flights[1], slice(0, None, 2))], "flight 1 has another step size"),
    ],
)
def test_flights_that_cannot_be_used_are_refused(flights, change, message):
    with pytest.raises(ValueError, match=message):
        fdie.identify(change(flights), LAB_X)


def test_an_unknown_gain_is_refused(flights):
    with pytest.raises(ValueError, match="fdie has no parameter observer_gains; it has observer_gain, "):
        fdie.identify(flights, LAB_X, {"observer_gains": (5, 8, 8, 5)})


def part(flight, rows):
    return Flight(
        flight.name,
        flight.time[rows],
        flight.rotor_speed_command[rows],
        flight.euler[rows],
        flight.body_rate[rows],
        flight.vertical_velocity[rows],
    )
