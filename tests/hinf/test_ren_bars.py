"""The figures of merit on Ren's vehicle with a few seeds; `make bars` flies all of them (tests/bars/hinf.py)."""

import numpy as np
import pytest

from tests.bars import hinf

pytestmark = pytest.mark.xdist_group("hinf-bars")


@pytest.mark.parametrize(("rotor", "loss"), [(1, 0.3), (4, 0.5)])
def test_a_loss_is_found_soon_without_bias_and_without_ghosts(rotor, loss):
    four, three, _ = hinf.proportional(rotor, loss, seeds=12)
    assert (four.diagnoser, three.diagnoser) == ("hinf", "hinf_tau3")
    assert four.settling_time <= 0.45
    assert abs(four.bias) <= 0.003
    assert four.ghost <= 0.004
    assert four.largest_std <= 0.010
    assert (four.named, three.named) == (1, 1)
    assert max(four.state_rms[:3]) <= 0.001  # the sensor's noise is 0.002
    assert max(four.state_rms[3:]) <= 0.010
    assert three.std <= 0.005


def test_a_loss_that_varies_is_followed():
    rms = hinf.time_varying(seeds=2)
    assert rms["hinf"] <= 0.010
    assert rms["hinf_tau3"] <= 0.004


def test_a_constant_disturbance_is_a_fault_until_it_is_known():
    found = hinf.disturbed(seeds=6)
    np.testing.assert_allclose(found.raw, found.expected, atol=0.003)
    assert np.abs(found.calibrated).max() <= 0.003
    assert np.abs(found.expected).min() > 0.07
