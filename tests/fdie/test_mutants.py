"""Mistakes that flights hardly reveal are seen by the checks of this folder: each mutant is killed by a named one."""

import numpy as np
import pytest

from rotordx.fmus.diagnosers import codegen
from rotordx.fmus.diagnosers.fdie import detection, isolation, model, set_membership
from rotordx.fmus.model_terms import terms
from tests.fdie import noisy_flights, test_equations, test_guarantees
from tests.fdie.world import Compiled
from tests.mutation import mutate


@pytest.fixture
def mutant(monkeypatch, tmp_path):
    """Builds the diagnoser with one mistake."""

    def build(*mutation) -> Compiled:
        mutate(monkeypatch, *mutation)
        return Compiled(codegen.diagnoser_function("fdie"), tmp_path)

    return build


@pytest.mark.parametrize(
    ("function", "old", "new"),
    [
        pytest.param(terms.coupling_torque, "vehicle.inertia * body_rate", "body_rate", id="no-inertia-in-phi"),
        pytest.param(terms.rate_dynamics, "coupling_torque(", "-coupling_torque(", id="rows-of-phi-with-wrong-sign"),
        pytest.param(
            terms.rate_dynamics,
            "coupling_torque(zeta[1:],",
            "coupling_torque(zeta[[2, 1, 3]],",
            id="rows-of-phi-swapped",
        ),
        pytest.param(terms.input_gain, "cos(euler[0]) * cos(euler[1])", "1", id="no-cos-cos"),
        pytest.param(terms.input_gain, "cos(euler[0]) * cos(euler[1])", "cos(euler[0])", id="one-cos"),
    ],
)
def test_wrong_known_models_are_not_the_derivative_of_the_plant(monkeypatch, function, old, new):
    mutate(monkeypatch, function, old, new)
    assert test_equations.model_deviation() > 1e-3


def test_kappa_of_one_end_only_is_not_the_largest_error(monkeypatch):
    mutate(monkeypatch, isolation.loe_error_bound, "loe_max / 2 + fabs(loe - loe_max / 2)", "loe_max - loe")
    with pytest.raises(AssertionError):
        test_equations.kappa_matches_brute_force(0.5, 0.8)


def test_without_projection_the_estimate_leaves_theta(mutant):
    outputs = test_equations.history(mutant(isolation.project, "fmin(fmax(loe, 0), loe_max)", "loe")).outputs
    assert outputs["fie_loe_estimate"].min() < 0


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param("bound = decay * bound + gain * uncertainty", "bound = bound + 0.5 * gain", id="constant-mu"),
        pytest.param(" + repmat(model.bound, 1, 4)", "", id="no-uncertainty-in-mu"),
        pytest.param("diag(loe_error_bound(loe, parameters.loe_max))", "diag(loe)", id="estimate-for-kappa"),
    ],
)
def test_wrong_isolation_thresholds_are_not_the_convolution(mutant, old, new):
    flight = test_equations.history(mutant(isolation.advance_isolation, old, new))
    assert test_equations.isolation_threshold_deviation(flight) > 1e-3


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param("gain * model.bound, start_bound", "gain * 0.5, start_bound", id="constant-threshold"),
        pytest.param("gain * (model.zeta_rate", "0.9 * gain * (model.zeta_rate", id="short-of-gain"),
    ],
)
def test_wrong_detection_estimators_differ_from_the_second_form(mutant, samples, old, new):
    assert worst_deviation(mutant(detection.advance_detection, old, new), samples) > 1e-3


@pytest.mark.parametrize(
    ("old", "new"),
    [
        pytest.param(
            "speed_before, speed = lagged_speed(started, state.rotor_speed, command, vehicle, dt)",
            "speed_before = speed = command.rotor_speed_command",
            id="no-lag",
        ),
        pytest.param(
            "nominal=vertcat(vertical[0] + drag,", "nominal=vertcat(nominal[0] + drag,", id="thrust-not-matched"
        ),
        pytest.param("bound=vertcat(vertical[1],", "bound=vertcat(bound[0],", id="bound-not-matched"),
        pytest.param("vertcat(vertical[2:6].T,", "vertcat(signatures[0, :],", id="h-not-matched"),
        pytest.param("vertical[0] + drag", "vertical[0]", id="no-drag"),
    ],
)
def test_unmatched_models_differ_from_the_second_form(mutant, samples, old, new):
    assert worst_deviation(mutant(model.known_model, old, new), samples) > 1e-5


def test_the_printed_exclusion_index_excludes_the_failed_rotor(mutant):
    """|zeta_tilde_s| > mu_r, as printed, compares the residual of another estimator."""
    printed = mutant(isolation.advance_isolation, "fabs(residual) >", "fabs(residual[:, [1, 2, 3, 0]]) >")
    assert test_guarantees.fly(printed, flights=120, steps=1000)["paper_excludes_truth"].any()


def test_exclusion_must_be_latched(mutant):
    unlatched = mutant(isolation.advance_isolation, "latch(state.excluded, ", "latch(0 * state.excluded, ")
    outputs = test_equations.history(unlatched).outputs
    assert (outputs["excluded"][1:] < outputs["excluded"][:-1]).any()


def test_without_the_remembered_signature_set_membership_loses_the_truth(mutant):
    forgetful = mutant(set_membership.allowed_loss, "full - fabs(remembered)", "full")
    assert test_guarantees.fly(forgetful, flights=120, steps=1000)["escaped"].any()


def test_a_held_measurement_is_a_worse_discretisation(mutant, continuous_flight):
    held = mutant(
        detection.advance_detection,
        "gain * (model.zeta_rate - model.nominal)",
        "clock.dt * model.zeta_rate - gain * model.nominal",
    )
    with pytest.raises(AssertionError):
        test_equations.test_discretisation_is_a_small_uncertainty(held, continuous_flight, 200.0)


def worst_deviation(diagnoser, samples):
    """Of a diagnoser from the second form on a flight with a loss."""
    flight = noisy_flights.FLIGHTS[:1]
    expected = noisy_flights.by_reference_form([column[:, 0] for column in samples], flight[0])
    outputs = noisy_flights.by_step(diagnoser, [column[:, :1] for column in samples], flight)
    names = ("residual", "threshold", "isolation_residual", "isolation_threshold", "set_upper", "set_lower")
    return max(np.nanmax(abs(outputs[name][:, 0] - expected[name])) for name in names)


@pytest.fixture(scope="module")
def samples():
    return noisy_flights.flown(2600, noisy_flights.FLIGHTS[:1])
