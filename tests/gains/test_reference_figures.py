"""Reference figures: those of the design notes, of closed forms, and of what the papers print."""

import numpy as np
import pytest

from rotordx.fmus.vehicles import Vehicle, load_vehicle
from rotordx.gains import adaptive_thau, fast_adaptive, hinf, rho_adaptive
from rotordx.gains.analysis import hinf_norm
from rotordx.gains.discretisation import spectral_radius, step_matrix
from rotordx.gains.options import DesignError, with_settings
from rotordx.gains.synthesis import Requirements, solve
from rotordx.gains.thau import thau_gain

#: K, P, F2 as Nguyen and Hong print them.
PRINTED_K = np.block([[100 * np.eye(3), np.eye(3)], [np.eye(3), 100 * np.eye(3)]])
PRINTED_P = 0.04 + np.diag([101.76, 101.77, *[101.76] * 4]) - 0.23 * np.eye(6)[[3, 4, 5, 0, 1, 2]]
PRINTED_F2 = np.array(
    [[-26, 5, 5, 13946, 5, 5], [5, -24, 5, 5, 12887, 5], [3, 3, -16, 3, 3, 8701]],
    dtype=float,
)
DOUBLE_INTEGRATORS = np.block([[np.zeros((3, 3)), np.eye(3)], [np.zeros((3, 6))]])


@pytest.mark.parametrize(("name", "optimum"), [("vz4", 0.042898), ("tau3", 0.057044)])
def test_smallest_gamma_of_the_hinf_observers(reference_design, name, optimum):
    proof = next(c.proof for c in reference_design.certificates if c.name == name)
    assert proof.gamma_optimum == pytest.approx(optimum, rel=0.01)
    assert proof.gamma_optimum <= proof.gamma <= 1.05 * proof.gamma_optimum * (1 + 1e-5)


@pytest.mark.parametrize("name", ["vz4", "tau3"])
def test_no_smaller_gamma_is_found_by_bisection(reference_design, reference_options, name):
    model = hinf.MODELS[name][0](load_vehicle("ren_plus"), reference_options)
    optimum = next(c.proof.gamma_optimum for c in reference_design.certificates if c.name == name)
    possible, impossible = 2 * optimum, 0.5 * optimum
    while possible - impossible > 1e-3 * optimum:
        middle = (possible + impossible) / 2
        if solve(model, reference_options, gamma=middle) is None:
            impossible = middle
        else:
            possible = middle
    assert optimum == pytest.approx(possible, rel=3e-3)


@pytest.mark.parametrize(("module", "name"), [(hinf, "tau3"), (fast_adaptive, "torques"), (adaptive_thau, "torques")])
def test_without_nonlinearity_gamma_is_the_gain_of_the_loop(module, name):
    # with L = 0 the inequality is the bounded real lemma of A + alpha I: its optimum for a gain is that norm
    craft = load_vehicle("ren_plus")
    settings = ["lipschitz=0", "decay_rate=1", *(['models=["tau3"]'] if module is hinf else [])]
    options = with_settings(module.Options(), settings)
    subject = module.subjects(craft, options, module.design(craft, options).parameters)[name]
    best = solve(subject.model, Requirements(decay_rate=1.0, disk_radius=None), gain=subject.gain)
    loop = next(subject.model.close(subject.gain))
    norm = hinf_norm(loop.A + np.eye(len(loop.A)), loop.B, loop.C, loop.F)
    assert best.gamma == pytest.approx(norm, rel=1e-4)


def test_per_axis_gains_tell_the_channels_apart(reference_design):
    axes = reference_design.certificates[0].figures["gamma_per_axis"]
    assert set(axes) == {"roll", "pitch", "yaw", "vertical"}
    assert axes["roll"] == pytest.approx(axes["pitch"], rel=1e-3)  # a symmetrical vehicle
    assert axes["roll"] < 0.6 * axes["yaw"]
    assert max(axes.values()) == pytest.approx(reference_design.certificates[0].figures["gamma_without_nonlinearity"])


@pytest.mark.parametrize(("convergence_rate", "lipschitz"), [(8.0, 1.42), (4.0, 0.5), (12.0, 3.0)])
def test_rho_adaptive_gain_is_the_closed_form_for_integrators(convergence_rate, lipschitz):
    model = rho_adaptive.DetectionModel(("p", "q", "r"), np.zeros((3, 3)), np.eye(3), np.eye(3), lipschitz)
    L, proof = rho_adaptive.detection_gain(model, convergence_rate)
    closed_form = 2 * convergence_rate + 2 * lipschitz + 1
    assert np.abs(L - closed_form * np.eye(3)).max() <= 1e-3 * closed_form
    assert np.abs(proof.P - np.eye(3)).max() <= 1e-3
    assert proof.optimum == pytest.approx(1 + closed_form, rel=1e-3)
    assert proof.noise_weight == pytest.approx(closed_form, rel=0.02)
    assert proof.uncertainty_weight == pytest.approx(1, rel=0.02)


def test_printed_gain_of_the_thau_paper_is_lemma_1_at_epsilon_100():
    K = thau_gain(DOUBLE_INTEGRATORS, np.eye(6), 100.0)
    assert np.abs(K - PRINTED_K).max() <= 1e-2 * (1 + 1e-6)


def test_lemma_1_holds_as_corrected_and_not_as_printed():
    K = thau_gain(DOUBLE_INTEGRATORS, np.eye(6), 100.0)
    P = np.linalg.inv(K)
    residual = DOUBLE_INTEGRATORS.T @ P + P @ DOUBLE_INTEGRATORS - np.eye(6) + 100 * P
    assert np.abs(residual).max() <= 1e-12
    assert np.linalg.eigvals(DOUBLE_INTEGRATORS - K).real.max() < -90
    assert np.linalg.eigvals(DOUBLE_INTEGRATORS + K).real.max() > 90  # the sign of (8) and (13): diverges


def test_printed_F2_belongs_to_another_inertia_than_table_1():
    F = np.vstack((np.zeros((3, 3)), np.eye(3)))
    by_table_1 = np.diag(1 / np.array([0.0035, 0.0035, 0.005])) @ F.T @ PRINTED_P
    implied = np.diag(PRINTED_P)[3:] / np.diag(PRINTED_F2[:, 3:])
    assert np.abs(PRINTED_F2 / by_table_1 - 1).max() > 0.4
    assert implied == pytest.approx([0.0073, 0.0079, 0.0117], rel=1e-3)
    by_implied = np.diag(1 / implied) @ F.T @ PRINTED_P
    assert np.abs(by_implied - PRINTED_F2).max() <= 0.6  # printed without decimals


@pytest.mark.parametrize("inertia", [(0.0035, 0.0035, 0.005), (0.0073, 0.0079, 0.0117)])
def test_both_readings_of_the_inertia_are_certified(inertia):
    craft = load_vehicle("f450_plus")
    read = Vehicle(craft.name, craft.description, craft.parameters | {"inertia": inertia})
    options = with_settings(adaptive_thau.Options(), ["learning_rate=[0.005, 0.005, 0.005]", "step_size=0.0025"])
    design = adaptive_thau.design(read, options)
    assert np.array(design.parameters["fault_gain"]).reshape(3, 6)[:, 3:] == pytest.approx(
        np.diag(101.8 / np.array(inertia)), rel=1e-5
    )
    assert design.certificates[0].figures["spectral_radius"] < 0.93


def test_explicit_euler_at_the_papers_step_is_unstable_with_its_own_gains():
    inertia = np.array([0.0035, 0.0035, 0.005])
    F = np.vstack((np.zeros((3, 3)), np.diag(1 / inertia)))
    A = np.block([[DOUBLE_INTEGRATORS - PRINTED_K, F], [-0.005 * F.T @ PRINTED_P, -0.005 * np.eye(3)]])
    assert spectral_radius(step_matrix(A, 0.0025, "euler")) == pytest.approx(1.0049, abs=1e-4)
    assert spectral_radius(step_matrix(A, 0.0025, "rk4")) < 0.95
    craft = load_vehicle("f450_plus")
    settings = ["learning_rate=[0.005, 0.005, 0.005]", "step_size=0.0025", "integrator=euler"]
    with pytest.raises(DesignError, match=r"explicit Euler at a step of 2.5 ms \(spectral radius 1\.004"):
        adaptive_thau.design(craft, with_settings(adaptive_thau.Options(), settings))
