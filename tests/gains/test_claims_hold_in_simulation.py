"""What certificates claim is what happens: bounds and figures against simulations that share no code with them."""

import itertools

import numpy as np
import pytest

from rotordx.fmus.model_terms import terms
from rotordx.fmus.shell.ports import flatten
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.gains import analysis, asmto, fast_adaptive, flight_model, hinf, inequalities, kalman, rho_adaptive, smo
from rotordx.gains.certificate import unplain
from rotordx.gains.flight_model import Envelope
from rotordx.gains.options import from_plain

OBSERVERS = [
    ("hinf", "vz4"),
    ("hinf", "tau3"),
    ("asmto", "torques"),
    ("fast_adaptive", "torques"),
    ("smo", "channels"),
    ("rho_adaptive", "adaptation"),
]
MODULES = {"hinf": hinf, "asmto": asmto, "fast_adaptive": fast_adaptive, "smo": smo, "rho_adaptive": rho_adaptive}


def subject_and_proof(document, name):
    module = MODULES[document["diagnoser"]]
    options = from_plain(module.Options, document["options"])
    subject = module.subjects(load_vehicle(document["vehicle"]), options, document["parameters"])[name]
    claim = next(c for c in document["certificates"] if c["name"] == name)
    return subject, unplain(subject.theory.proof, claim["proof"]), claim["figures"]


def random_rotation(rng, rows, columns):
    """Matrix of norm 1."""
    left, _ = np.linalg.qr(rng.normal(size=(max(rows, columns),) * 2))
    return left[:rows, :columns]


@pytest.mark.parametrize(("diagnoser", "name"), OBSERVERS)
@pytest.mark.parametrize("vehicle", ["lab_x", "crazyflie"])
def test_no_disturbance_or_nonlinearity_beats_gamma(packaged, vehicle, diagnoser, name):
    subject, proof, _ = subject_and_proof(packaged(vehicle, diagnoser), name)
    loops = list(subject.model.close(subject.gain))
    rng, h = np.random.default_rng(3), 2e-4
    worst = 0.0
    for trial in range(4):
        loop = loops[trial % len(loops)]
        # the worst sinusoid of the linear loop, or band-limited noise, with a nonlinearity of the largest size
        frequency = 10.0 ** rng.uniform(0, 2)
        direction = rng.normal(size=loop.B.shape[1])
        e, energy_in, energy_out = np.zeros(len(loop.A)), 0.0, 0.0
        U = random_rotation(rng, loop.D.shape[1], len(loop.N))
        for k in range(5000):
            w = direction * np.sin(frequency * k * h) * (k < 4000)
            z = loop.C @ e + loop.F @ w
            energy_in, energy_out = energy_in + w @ w, energy_out + z @ z
            e = e + h * (loop.A @ e + loop.B @ w + loop.D @ (loop.lipschitz * U @ (loop.N @ e)))
        worst = max(worst, energy_out / energy_in)
    assert worst <= proof.gamma**2


@pytest.mark.parametrize(("diagnoser", "name"), OBSERVERS)
def test_errors_decay_at_the_certified_rate_among_all_corners(packaged, diagnoser, name):
    subject, proof, _ = subject_and_proof(packaged("lab_x", diagnoser), name)
    loops = list(subject.model.close(subject.gain))
    rng, h = np.random.default_rng(4), 2e-5
    for _ in range(3):
        e = rng.normal(size=len(loops[0].A))
        start = e @ proof.P @ e
        for k in range(10000):  # switching among corners and nonlinearities at random
            if k % 200 == 0:
                loop = loops[rng.integers(len(loops))]
                U = random_rotation(rng, loop.D.shape[1], len(loop.N))
            e = e + h * (loop.A @ e + loop.D @ (loop.lipschitz * U @ (loop.N @ e)))
        assert e @ proof.P @ e <= start * np.exp(-2 * proof.decay_rate * 10000 * h) * 1.001


@pytest.mark.parametrize(("diagnoser", "name"), OBSERVERS)
def test_each_discrete_step_contracts_the_lyapunov_function(packaged, diagnoser, name):
    subject, proof, figures = subject_and_proof(packaged("lab_x", diagnoser), name)
    rng = np.random.default_rng(5)
    for loop in subject.model.close(subject.gain):
        for _ in range(20):
            e = rng.normal(size=len(loop.A))
            k1 = loop.A @ e
            k2 = loop.A @ (e + proof.step_size / 2 * k1)
            k3 = loop.A @ (e + proof.step_size / 2 * k2)
            k4 = loop.A @ (e + proof.step_size * k3)
            after = e + proof.step_size / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            assert after @ proof.P @ after < e @ proof.P @ e
    assert figures["spectral_radius"] < 1


@pytest.mark.parametrize(("diagnoser", "name"), OBSERVERS)
def test_the_hinf_norm_is_the_peak_of_the_frequency_response(packaged, diagnoser, name):
    subject, _, figures = subject_and_proof(packaged("ren_plus", diagnoser), name)
    peak = 0.0
    for loop in subject.model.close(subject.gain):
        for frequency in np.concatenate(([0.0], np.geomspace(1e-3, 1e4, 4000))):
            response = loop.F + loop.C @ np.linalg.solve(1j * frequency * np.eye(len(loop.A)) - loop.A, loop.B)
            peak = max(peak, np.linalg.norm(response, 2))
    assert figures["gamma_without_nonlinearity"] == pytest.approx(peak, rel=1e-4)


@pytest.mark.parametrize(("diagnoser", "name"), [("hinf", "vz4"), ("rho_adaptive", "adaptation")])
def test_the_noise_of_the_estimates_is_that_of_a_long_run(packaged, diagnoser, name):
    subject, proof, figures = subject_and_proof(packaged("lab_x", diagnoser), name)
    loop = next(subject.model.close(subject.gain))
    noise = loop.B[:, subject.model.disturbances :]
    rng, h = np.random.default_rng(6), proof.step_size
    e, samples = np.zeros(len(loop.A)), []
    for k in range(30000):
        v = noise @ rng.normal(size=noise.shape[1])  # held over the step, RK4
        k1 = loop.A @ e + v
        k2 = loop.A @ (e + h / 2 * k1) + v
        k3 = loop.A @ (e + h / 2 * k2) + v
        k4 = loop.A @ (e + h * k3) + v
        e = e + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if k > 2000:
            samples.append(e[subject.model.faults])
    assert np.std(samples, axis=0) == pytest.approx(figures["noise_std"], rel=0.12)


@pytest.mark.parametrize("vehicle", ["lab_x", "crazyflie", "f450_plus", "ren_plus"])
def test_lipschitz_constants_bound_the_dynamics_over_the_envelope_and_are_reached(vehicle):
    craft, envelope = load_vehicle(vehicle), Envelope()
    numbers = craft.fill(VehicleParameters)
    hover = flight_model.flight_model(craft)
    of_rates = flight_model.rate_lipschitz(craft, envelope)
    of_all = flight_model.attitude_lipschitz(craft, envelope)
    A = hover.jacobian[1:, 1:]
    rng, largest = np.random.default_rng(7), 0.0
    J, Jr = np.asarray(numbers.inertia), float(numbers.rotor_inertia)
    d = np.asarray(numbers.rotor_direction)

    def acceleration(rate, speed):  # Euler's equations with the rotors' momentum, written out
        p, q, r = rate
        H = -Jr * float(d @ speed)
        gyro = np.array([(J[1] - J[2]) * q * r - q * H, (J[2] - J[0]) * p * r + p * H, (J[0] - J[1]) * p * q])
        return gyro / J

    corners = [np.array(c) * envelope.body_rate for c in itertools.product((-1, 1), repeat=3)]
    for trial in range(4000):
        speed = hover.hover_speed.copy()
        speed[trial % 4] *= rng.uniform(1, 1 / np.sqrt(1 - envelope.loss_of_effectiveness))
        one = corners[trial % 8] if trial % 2 else rng.uniform(-1, 1, 3) * envelope.body_rate
        if trial % 2:
            speed = hover.hover_speed * np.where(np.arange(4) == trial // 2 % 4, 2**0.5, 1.0)
        other = one + 1e-4 * rng.normal(size=3) if trial % 2 else rng.uniform(-1, 1, 3) * envelope.body_rate
        change = acceleration(one, speed) - acceleration(other, speed) - A @ (one - other)
        ratio = np.linalg.norm(change) / np.linalg.norm(one - other)
        assert ratio <= of_rates * (1 + 1e-3)
        largest = max(largest, ratio)
        roll, pitch = rng.uniform(-1, 1, 2) * envelope.tilt
        if np.cos(roll) * np.cos(pitch) >= np.cos(envelope.tilt):
            attitude = np.array([roll, pitch, 0.0])
            euler = _euler_rate(attitude, one) - _euler_rate(attitude, other) - (one - other)
            both = np.hypot(np.linalg.norm(euler), np.linalg.norm(change))
            assert both <= of_all * (1 + 1e-3) * np.linalg.norm(one - other)
    assert largest >= 0.9 * of_rates


@pytest.mark.parametrize(("vehicle", "rotor"), [("lab_x", 0), ("lab_x", 2), ("crazyflie", 1), ("ren_plus", 3)])
def test_hinf_gains_find_a_lost_rotor_on_the_nonlinear_vehicle(packaged, vehicle, rotor):
    """The observer as a diagnoser runs it: model terms, velocity filter, the gains as stored; 20 % lost at 0.2 s."""
    document = packaged(vehicle, "hinf")
    craft = load_vehicle(vehicle)
    numbers = craft.fill(VehicleParameters)
    column = np.hstack([np.atleast_1d(v) for v in flatten(numbers, lambda *values: values)])
    rates, hover = _functions(), flight_model.flight_model(craft)
    L = np.array(document["parameters"]["observer_gain"]).reshape(13, 7)
    w0 = document["parameters"]["velocity_filter_bandwidth"]
    h, loss = 0.002, 0.2
    zeta, euler, F = np.zeros(4), np.zeros(3), np.zeros(2)
    estimate = np.zeros(13)
    history = []
    for k in range(600):
        t = k * h
        effective = np.where((np.arange(4) == rotor) & (t >= 0.2), 1 - loss, 1.0)
        swing = 1 + 0.02 * np.sin(
            9 * t + np.arange(4)
        )  # the vehicle moves, and a perfect controller makes up for the loss
        squared = hover.hover_speed**2 * swing / effective
        true = np.array(rates(zeta, euler, np.sqrt(squared * effective), column)).ravel()
        filtered = F[1]
        y = np.array([*euler, *zeta[1:], filtered])

        def derivative(z, y=y, squared=squared):
            known = np.array(rates(np.array([0.0, *z[3:6]]), y[:3], np.sqrt(squared), column)).ravel()
            fault = -hover.signatures @ z[9:]  # accelerations by the estimated faults
            dz = np.zeros(13)
            dz[:3] = _euler_rate(y[:3], z[3:6])
            dz[3:6] = known[1:] + fault[1:]
            drag = -float(numbers.drag_coefficient) / float(numbers.mass)
            dz[6] = w0**2 * z[7] - 2 * w0 * z[6]
            dz[7] = z[8] - z[6]
            dz[8] = drag * z[8] + known[0] + fault[0] * np.cos(y[0]) * np.cos(y[1])
            return dz + L @ (y - z[:7])

        k1 = derivative(estimate)
        k2 = derivative(estimate + h / 2 * k1)
        k3 = derivative(estimate + h / 2 * k2)
        k4 = derivative(estimate + h * k3)
        estimate = estimate + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        history.append(estimate[9:].copy())
        F = F + h * np.array([w0 * (zeta[0] - F[0]), w0 * (F[0] - F[1])])
        euler = euler + h * _euler_rate(euler, zeta[1:])
        zeta = zeta + h * true
    fault = np.zeros(4)
    fault[rotor] = -loss / (1 - loss)  # missing part of the squared speed over that in hover
    settled = max(next(c for c in document["certificates"] if c["name"] == "vz4")["figures"]["settling_time"])
    after = np.array(history[int((0.2 + settled) / h) + 5 :])
    assert np.abs(after - fault).max() <= 0.08 * loss / (1 - loss)
    assert np.abs(np.array(history[:100])).max() <= 0.01


def test_a_steady_filter_has_the_errors_that_its_certificate_says(packaged):
    document = packaged("lab_x", "askf")
    options = from_plain(kalman.Options, document["options"])
    model = kalman.filter_model(load_vehicle("lab_x"), options, losses=True)
    K, proof = kalman.steady_filter(model, options.step_size)
    assert K.flatten() == pytest.approx(document["parameters"]["kalman_gain"], rel=1e-4, abs=1e-6)
    P = proof.P
    rng = np.random.default_rng(8)
    variances, directions = np.linalg.eigh(model.Q)  # singular: one noise drives both states of the velocity filter
    Q, R = directions * np.sqrt(np.maximum(variances, 0)), np.sqrt(np.diag(model.R))
    errors = np.zeros((len(model.states), 2000))  # of predictions, many runs at once
    for _ in range(1500):
        updated = errors - K @ (model.C @ errors + R[:, None] * rng.normal(size=(4, 2000)))
        errors = model.A @ updated + Q @ rng.normal(size=errors.shape)
    measured = errors @ errors.T / errors.shape[1]
    assert np.diag(measured) == pytest.approx(np.diag(P), rel=0.12)
    assert np.linalg.eigvalsh(1.15 * P - measured)[0] > 0


@pytest.mark.parametrize("losses", [False, True])
def test_the_covariance_bound_is_above_the_steady_covariance_by_a_percent_at_most(losses):
    options = kalman.Options()
    model = kalman.filter_model(load_vehicle("crazyflie"), options, losses=losses)
    K, proof = kalman.steady_filter(model, options.step_size)
    after = np.eye(len(K)) - K @ model.C
    covariance = np.zeros(model.A.shape)
    for _ in range(5000):  # update in Joseph's form, then prediction
        covariance = model.A @ (after @ covariance @ after.T + K @ model.R @ K.T) @ model.A.T + model.Q
    assert np.linalg.eigvalsh(proof.P - covariance)[0] > 0
    assert (np.diag(proof.P) / np.diag(covariance) - 1).max() < 0.01


def test_the_bound_on_a_scalar_filter_is_its_covariance_and_nothing_less():
    # e+ = e / 2 + 0.3 v + w with variances 2 and 1: the steady variance is (0.09 * 2 + 1) / (1 - 1/4)
    steady = 1.18 / 0.75
    rest = [np.array([[v]]) for v in (0.5, 0.3, 2.0, 1.0)]
    assert inequalities.covariance_bound(np.array([[steady * 1.001]]), *rest)[0, 0] > 0
    assert inequalities.covariance_bound(np.array([[steady * 0.999]]), *rest)[0, 0] < 0


def test_fast_adaptive_estimates_have_the_noise_that_its_certificate_says(packaged):
    """The estimator as its equations stand: proportional and integral part of the output error, no augmented state."""
    document = packaged("lab_x", "fast_adaptive")
    craft, parameters = load_vehicle("lab_x"), document["parameters"]
    inertia = np.array(craft.parameters["inertia"])
    scale = np.abs(flight_model.flight_model(craft).signatures[1:]).max(axis=1) * inertia  # N.m
    B = np.vstack((np.zeros((3, 3)), np.diag(1 / inertia)))
    A = np.eye(6, k=3)
    L = np.array(parameters["observer_gain"]).reshape(6, 6)
    F = np.array(parameters["fault_gain"]).reshape(3, 6)
    Gamma, sigma = np.array(parameters["learning_rate"]), parameters["integral_rate"]
    size = np.diag(document["certificates"][0]["model"]["V"])
    rng, h, true = np.random.default_rng(9), 0.002, 0.2 * scale
    x_hat, integral, samples = np.zeros(6), np.zeros(3), []
    for _ in range(40000):
        y = size * rng.normal(size=6)  # the body rests: a controller holds it against the fault
        e = x_hat - y
        f_hat = -Gamma * (F @ e + sigma * integral)
        samples.append(f_hat / scale)
        for _ in range(4):  # explicit Euler with a quarter of the step, the measurement held
            e = x_hat - y
            f_hat = -Gamma * (F @ e + sigma * integral)
            x_hat = x_hat + h / 4 * (A @ x_hat + B @ (f_hat - true) - L @ e)
            integral = integral + h / 4 * (F @ e)
    samples = np.array(samples[2000:])
    assert samples.mean(axis=0) == pytest.approx([0.2] * 3, abs=0.01)
    assert samples.std(axis=0) == pytest.approx(document["certificates"][0]["figures"]["noise_std"], rel=0.1)


def test_undetectable_directions_are_exactly_those_that_no_output_shows():
    A = np.zeros((3, 3))
    A[0, 1], A[0, 2] = 1.0, -1.0  # two faults that act on one integrator
    found = analysis.undetectable_directions(A, np.eye(1, 3))
    assert found.shape == (3, 1)
    assert np.abs(found[:, 0]) == pytest.approx([0, 2**-0.5, 2**-0.5])
    assert found[1, 0] == pytest.approx(found[2, 0])
    assert analysis.undetectable_directions(A, np.eye(3)).shape == (3, 0)


def _euler_rate(euler, rate):
    roll, pitch, _ = euler
    p, q, r = rate
    turning = np.sin(roll) * q + np.cos(roll) * r
    return np.array([p + turning * np.tan(pitch), np.cos(roll) * q - np.sin(roll) * r, turning / np.cos(pitch)])


def _functions():
    from casadi import SX, Function

    from rotordx.fmus.model_terms.symbols import symbols

    column, vehicle = symbols(VehicleParameters, "vehicle")
    zeta, euler, speed = SX.sym("zeta", 4), SX.sym("euler", 3), SX.sym("speed", 4)
    return Function("rates", [zeta, euler, speed, column], [terms.rate_dynamics(zeta, euler, speed, vehicle)])
