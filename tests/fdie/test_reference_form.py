"""The step agrees with a second, independently written form of the method over 30,000 steps."""

import pytest

from tests.fdie.noisy_flights import FLIGHTS, STEPS, by_reference_form, by_step, deviation, flown

#: on one worker, because the flights are flown once for all tests
pytestmark = pytest.mark.xdist_group("fdie-reference-form")


@pytest.fixture(scope="module")
def samples():
    return flown(STEPS)


@pytest.fixture(scope="module")
def outputs(diagnoser, samples):
    return by_step(diagnoser, samples)


@pytest.mark.parametrize("flight", range(len(FLIGHTS)))
def test_step_equals_the_second_form(samples, outputs, flight):
    expected = by_reference_form([column[:, flight] for column in samples], FLIGHTS[flight])
    actual = {name: values[:, flight] for name, values in outputs.items()}
    assert deviation(actual, expected) < 1e-12
    rotor, loss, _ = FLIGHTS[flight]
    assert expected["fault_detected"][-1] == (loss > 0)
    assert expected["faulty_rotor"][-1] == {0.0: 0, 0.8: -1}.get(loss, rotor + 1)
