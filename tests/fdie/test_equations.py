"""The equations of `fdie` against independent evaluations: plant derivative, quadrature, brute force, exact motion."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from casadi import SX, Function, vec, vertcat
from hypothesis import given
from hypothesis import strategies as st

from rotordx.fmus.diagnosers.fdie import isolation, model, set_membership
from rotordx.fmus.diagnosers.fdie.step import Parameters, State
from rotordx.fmus.diagnosers.interface import Clock, Inputs
from rotordx.fmus.model_terms.symbols import symbols
from rotordx.fmus.shell.ports import start_values, unflatten
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.fmus.vehicles.spread import perturbed
from tests.equations import paper_model
from tests.fdie.reference_form import ReferenceFdie
from tests.fdie.world import DT, IDEAL, Diagnosers, World, parameter_values

#: on one worker, because the flights are flown once for all tests
pytestmark = pytest.mark.xdist_group("fdie-equations")
SKEWED = perturbed(load_vehicle("lab_x"), np.random.default_rng(3), scale=5).fill(VehicleParameters)


def first_sample(zeta, euler, command, vehicle):
    """f (n, 4) and [h_1 .. h_4] (n, 16, rotor-major) that `fdie` uses on a first sample, where all lags are settled."""
    u, inputs = symbols(Inputs)
    state = unflatten(State, SX(start_values(State)))
    parameters = Parameters(**parameter_values())
    _, known = model.known_model(inputs, inputs, SX(0), SX(0), state, parameters, vehicle, Clock(0, DT))
    function = Function("known", [u], [vertcat(known.nominal, vec(known.signatures))])
    rows = np.array(function.map(len(zeta))(np.hstack([command, euler, zeta[:, 1:], zeta[:, :1]]).T)).T
    return rows[:, :4], rows[:, 4:]


def derivative(zeta, euler, command, vehicle):
    """d[v_z, p, q, r]/dt of the plant in the paper's own equations."""
    vertical = paper_model.acceleration(np.array([0, 0, zeta[0]]), euler, command, vehicle)[2]
    return np.array([vertical, *paper_model.angular_acceleration(euler, zeta[1:], command, vehicle)])


def signature_by_loss(zeta, euler, command, vehicle):
    """Change of the derivative when each rotor in turn loses all thrust and torque but keeps turning."""
    healthy = derivative(zeta, euler, command, vehicle)
    changes = []
    for s in range(4):
        left = np.arange(4) != s
        lost = dataclasses.replace(
            vehicle,
            thrust_coefficient=vehicle.thrust_coefficient * left,
            torque_coefficient=vehicle.torque_coefficient * left,
        )
        changes.append(derivative(zeta, euler, command, lost) - healthy)
    return np.concatenate(changes)


def model_deviation():
    """Largest relative deviation of f and h_s from the plant at 1,000 random large states."""
    rng = np.random.default_rng(0)
    zeta = rng.uniform(-10, 10, (1000, 4))
    euler = rng.uniform([-np.pi, -1.2, -np.pi], [np.pi, 1.2, np.pi], (1000, 3))
    command = rng.uniform(0, 950, (1000, 4))
    actual = np.hstack(first_sample(zeta, euler, command, SKEWED))
    rows = list(zip(zeta, euler, command, strict=True))
    expected = np.array([[*derivative(*row, SKEWED), *signature_by_loss(*row, SKEWED)] for row in rows])
    return np.max(abs(actual - expected) / np.maximum(1, abs(expected).max(axis=0)))


def test_model_is_the_derivative_of_the_plant():
    assert model_deviation() < 1e-9


@given(st.floats(0.01, 0.99), st.floats(0, 1))
def test_kappa_is_the_largest_possible_error(loe_max, fraction):
    kappa_matches_brute_force(loe_max, fraction)


def kappa_matches_brute_force(loe_max, fraction):
    estimate = fraction * loe_max
    brute_force = np.max(abs(np.linspace(0, loe_max, 1001) - estimate))
    assert float(isolation.loe_error_bound(estimate, loe_max)) == pytest.approx(brute_force, abs=1e-12)


@given(st.floats(-10, 10), st.floats(0.01, 0.99))
def test_projection_is_the_nearest_loss(loe, loe_max):
    grid = np.linspace(0, loe_max, 2001)
    nearest = grid[np.argmin(abs(grid - loe))]
    assert float(isolation.project(loe, loe_max)) == pytest.approx(nearest, abs=loe_max / 2000)
    assert 0 <= float(isolation.project(loe, loe_max)) <= loe_max


signed = st.floats(-5, 5).filter(lambda value: abs(value) > 1e-3)


@given(st.floats(0, 0.9), signed, st.floats(0, 1), st.floats(0, 1), st.floats(-1, 1), st.floats(1e-6, 3))
def test_no_channel_excludes_a_loss_that_explains_it(loss, full, share, part, noise, bound):
    """Whatever part of the remembered signature is missing, and whatever the error inside the bound."""
    remembered = share * full
    residual = loss * (full - part * remembered) + noise * bound
    least, most = set_membership.allowed_loss(
        SX([residual] * 4), SX([bound] * 4), SX(full) * SX.ones(4, 4), SX(remembered) * SX.ones(4, 4)
    )
    assert float(least[0, 0]) <= loss + 1e-9
    assert float(most[0, 0]) >= loss - 1e-9


def test_without_memory_and_noise_the_loss_is_known_exactly():
    signature = np.outer([1.0, -2.0, 3.0, -0.5], np.ones(4))
    least, most = set_membership.allowed_loss(SX(0.3 * signature[:, 0]), SX.zeros(4), SX(signature), SX.zeros(4, 4))
    np.testing.assert_allclose(np.array(least.nonzeros(), float), 0.3, rtol=1e-14)
    np.testing.assert_allclose(np.array(most.nonzeros(), float), 0.3, rtol=1e-14)


@dataclasses.dataclass
class History:
    """One flight through the diagnoser, with what the reference form says the model was in each step."""

    outputs: dict
    bound: np.ndarray  #: (N, 4)
    signatures: np.ndarray  #: (N, 4, 4) [rotor, channel]


def history(diagnoser, steps=1500, loss=0.25, rotor=2, onset=1.0):
    """A flight with a loss in which xi is zero; row 0 is the first sample."""
    world = World(1, 5, np.array([onset]), np.array([rotor]), np.array([loss]))
    diagnosers = Diagnosers(1, diagnoser, **IDEAL)
    reference = ReferenceFdie(SimpleNamespace(**parameter_values(**IDEAL)), world.vehicle, DT)
    reference.first_time, reference.filter = 0.0, None
    reference.zeta, reference.speed, reference.old_speed = world.zeta[0], world.command[0], world.command[0]
    rows, bounds, signatures = [], [], []
    for k in range(steps):
        if k:
            world.advance(np.zeros((1, 4)))
        rows.append(diagnosers.sample(world.time, world.command, world.euler, world.zeta))
        _, h, _, bound = reference.known(world.command[0], world.euler[0], world.zeta[0])
        reference.zeta = world.zeta[0]
        bounds.append(bound)
        signatures.append(h)
    outputs = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    return History(outputs, np.array(bounds), np.array(signatures))


def convolution(rate, held, initial, fine=50):
    """integral of exp(-rate (t - tau)) held(tau) d tau + exp(-rate t) initial at every step, by the midpoint rule.

    `held[k]` is constant over step k; the result has one more element, its first one the initial value.
    """
    tau = (np.arange(len(held) * fine) + 0.5) * DT / fine
    value = np.repeat(held, fine)
    ends = np.arange(len(held) + 1) * DT
    weights = np.exp(-rate * np.clip(ends[:, None] - tau[None], 0, None)) * (tau[None] < ends[:, None])
    return weights @ value * DT / fine + np.exp(-rate * ends) * initial


def detection_threshold_deviation(flight):
    """Of epsilon_bar from (22) by quadrature, over the first 400 steps."""
    gain = parameter_values()["observer_gain"]
    deviation = 0.0
    for j in range(4):
        expected = convolution(gain[j], flight.bound[1:401, j], flight.outputs["threshold"][0, j])
        deviation = max(deviation, np.max(abs(flight.outputs["threshold"][:401, j] / expected - 1)))
    return deviation


def isolation_threshold_deviation(flight, steps=300):
    """Of mu_s from (30) by quadrature, over 300 steps from detection on, kappa_s by brute force."""
    values = parameter_values()
    start = int(np.argmax(flight.outputs["fault_detected"] > 0))
    losses = np.linspace(0, values["loe_max"], 501)
    deviation = 0.0
    for s in range(4):
        estimate = flight.outputs["fie_loe_estimate"][start : start + steps, s]
        kappa = np.max(abs(losses[None] - estimate[:, None]), axis=1)
        for j in range(4):
            rows = slice(start + 1, start + 1 + steps)
            held = kappa * abs(flight.signatures[rows, s, j]) + flight.bound[rows, j]
            expected = convolution(values["isolation_gain"][j], held, 0.0)[1:]
            actual = flight.outputs["isolation_threshold"][rows, 4 * s + j]
            deviation = max(deviation, np.max(abs(actual / expected - 1)))
    return deviation


def test_detection_thresholds_are_the_convolution_of_the_bound(flight):
    assert detection_threshold_deviation(flight) < 1e-6


def test_isolation_thresholds_are_the_convolution_of_kappa_h_and_bound(flight):
    assert flight.outputs["fault_detected"][-1]
    assert isolation_threshold_deviation(flight) < 1e-6


@pytest.fixture(scope="module")
def flight(diagnoser):
    return history(diagnoser)


@pytest.mark.parametrize("gain", [8.0, 50.0, 200.0])
def test_discretisation_is_a_small_uncertainty(diagnoser, continuous_flight, gain):
    """No noise, exact model: l |epsilon| <= 0.01 m/s2, rad/s2 once the start is forgotten (00-conventions)."""
    diagnosers = Diagnosers(1, diagnoser, observer_gain=np.full(4, gain), warm_up_time=1e9)
    residuals = []
    for k, (command, x) in enumerate(continuous_flight):
        zeta = np.array([[x[11], *x[4:7]]])
        residuals.append(diagnosers.sample(k * DT, command[None], x[None, 1:4], zeta)["residual"][0])
    assert gain * np.max(np.abs(residuals[500:])) <= 0.01
