"""The paper's linear channels: what its printed figures allow, and what they do not."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rotordx.orchestrator.reproduction import msjfo
from rotordx.orchestrator.reproduction.msjfo import filter_costs as costs
from rotordx.orchestrator.reproduction.msjfo import linear_channels as channels
from rotordx.orchestrator.reproduction.msjfo.linear_channels import EXPERIMENTS

SEEDS = 6


@pytest.fixture(scope="module")
def outcomes():
    return {
        (e.name, name): channels.run(e, scale, SEEDS) for e in EXPERIMENTS for name, scale in msjfo.SETTINGS.items()
    }


@pytest.mark.parametrize("gain", [1.0, 0.02])
def test_a_channel_is_its_differential_equation(gain):
    A, B = channels.channel_matrices(gain)
    x, u = np.array([0.3, -0.2, 0.1]), 0.7
    w = channels.BANDWIDTH
    solution = solve_ivp(
        lambda t, x: [x[1], x[2] / channels.INERTIA, w * (gain * u - x[2])],
        (0, channels.STEP_SIZE),
        x,
        rtol=1e-12,
        atol=1e-14,
    )
    np.testing.assert_allclose(A @ x + B * u, solution.y[:, -1], atol=1e-12)


def test_both_filters_are_one_and_consistent(outcomes):
    for outcome in outcomes.values():
        assert outcome.difference_from_askf < 1e-9
        assert 0.9 <= outcome.innovation[channels.SETTLED :].mean() <= 1.1
    pooled = np.mean([outcome.innovation[channels.SETTLED :].mean() for outcome in outcomes.values()])
    assert 0.95 <= pooled <= 1.05


def test_the_printed_covariances_do_not_give_the_printed_errors(outcomes):
    first, second, _ = EXPERIMENTS
    assert np.all(msjfo._errors(outcomes["2", "printed"], second) > 10 * np.array(msjfo.PRINTED_ERRORS))
    assert msjfo._largest_state_error(outcomes["1", "printed"], first) > 0.3


def test_a_ten_thousandth_of_them_gives_the_state_error(outcomes):
    assert 0.004 <= msjfo._largest_state_error(outcomes["1", "implied"], EXPERIMENTS[0]) <= 0.008


def test_walking_losses_have_a_floor_that_the_table_undercuts(outcomes):
    """|N(0, Q)| is 0.798 sqrt(Q) on average: a loss is at least as unknown as its last step."""
    errors = msjfo._errors(outcomes["2", "implied"], EXPERIMENTS[1])
    assert np.all(errors > 0.798 * 0.01)
    loud = channels.run(EXPERIMENTS[1], 1e-4, SEEDS, walking=False, amplitude=10.0)
    assert np.all(msjfo._errors(loud, EXPERIMENTS[1]) <= 1.2 * np.array(msjfo.PRINTED_ERRORS))


def test_the_printed_sign_does_not_converge():
    assert channels.printed_sign_error(seeds=1) > 0.3


def test_the_reproduction_judges_every_claim_without_a_compiler(monkeypatch):
    monkeypatch.setattr(costs, "COMPILER", "no-such-compiler")
    monkeypatch.setattr(msjfo, "SIZES", {(3, 1, 3): ("a channel", True)})
    shares = []
    result = msjfo.reproduce(2, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    holds = {claim.quantity: claim.holds for claim in result.claims}
    assert None not in holds.values()
    assert not holds["estimation accuracy against the ASKF"]
    flown = [holds[quantity] for quantity in holds if "flown on lab_x" in quantity]
    assert flown == [True] * 3
    assert len(result.figures) == 10


def test_time_is_measured_where_there_is_a_compiler(tmp_path):
    seconds = costs.measured_seconds(costs.FORMS["ASKF, dense"](3, 1, 1), tmp_path)
    assert seconds is not None
    assert 0 < seconds < 1e-3
