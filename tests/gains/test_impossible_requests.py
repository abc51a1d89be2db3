"""Requests that cannot be met end with a sentence that names the cause and what to change."""

import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains import adaptive_thau, askf, asmto, hinf, smo, thau
from rotordx.gains.options import DesignError, with_settings


def refusal(module, vehicle, *settings):
    with pytest.raises(DesignError) as caught:
        module.design(load_vehicle(vehicle), with_settings(module.Options(), settings))
    return str(caught.value)


@pytest.mark.parametrize("vehicle", ["ren_plus", "lab_x", "crazyflie"])
def test_four_rotor_faults_cannot_be_told_from_attitude_alone(vehicle):
    sentence = refusal(hinf, vehicle, 'models=["attitude4"]')
    assert "the direction [1, 1, 1, 1] of the faults leaves attitude and body rates as they are" in sentence
    assert "model vz4" in sentence


def test_a_lipschitz_constant_beyond_the_gains_is_named_with_the_largest_possible():
    sentence = refusal(hinf, "ren_plus", "lipschitz=200", 'models=["tau3"]')
    assert sentence.startswith("the Lipschitz constant 200 1/s of the nonlinearity is larger than ")
    assert "narrow the envelope" in sentence


def test_the_lipschitz_condition_that_lemma_1_omits_is_checked():
    assert "the largest that can be certified" in refusal(thau, "lab_x", "speed=0.01")


@pytest.mark.parametrize(
    ("module", "settings"),
    [
        (thau, ("step_size=0.03",)),
        (thau, ("step_size=0.021", "integrator=euler")),
        (adaptive_thau, ("learning_rate=[0.05, 0.05, 0.05]", "step_size=0.01", "integrator=euler")),
        (smo, ("layer_gain=2000",)),
    ],
)
def test_a_step_that_is_too_long_is_named_with_its_spectral_radius(module, settings):
    sentence = refusal(module, "lab_x", *settings)
    assert "the observer is unstable when it runs with " in sentence
    assert "spectral radius" in sentence
    assert "; take " in sentence


def test_the_pure_sign_of_the_sliding_term_is_unstable():
    assert "a thicker boundary layer" in refusal(asmto, "lab_x", "noise_multiple=0.02")
    assert "no quadratic form proves a decay of 2 1/s for these gains" in refusal(asmto, "lab_x", "noise_multiple=0.07")


def test_poles_cannot_be_slower_than_the_decay():
    assert "larger disk_radius" in refusal(hinf, "ren_plus", "disk_radius=0.9", 'models=["tau3"]')


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("spead=2", "did you mean speed"),
        ("speed=0", "must be positive"),
        ("speed=-1", "must be positive"),
        ("speed=nan", "must be finite"),
        ("speed=fast", "must be a number"),
        ("integrator=rk5", "must be one of euler, heun, rk4, exact"),
        ("body_rate=[1, 2]", "a list of the right length"),
        ("loss_of_effectiveness=1.5", "must be at most 0.99"),
        ("speed", "not of the form NAME=VALUE"),
        ('models=["vz5"]', "choose among vz4, tau3, attitude4"),
    ],
)
def test_a_wrong_option_is_named(setting, message):
    assert message in refusal(hinf, "lab_x", setting)


def test_gamma_without_room_for_rounding_is_refused():
    assert "take at least 1.03" in refusal(hinf, "ren_plus", "gamma_ratio=1.0", 'models=["tau3"]')


def test_kalman_filters_need_noise():
    assert "must be positive" in refusal(askf, "lab_x", "thrust_noise=0")
