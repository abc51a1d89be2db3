"""Ren (2020): an H-infinity observer of state and rotor faults, on a quadrotor whose rotor 1 loses effectiveness."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.model_terms.terms import coupling_torque
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.gains import fault_models, hinf
from rotordx.gains.analysis import undetectable_directions
from rotordx.gains.flight_model import attitude_lipschitz, flight_model
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.reproduction import Claim, Progress, Reproduction
from rotordx.orchestrator.reproduction.ren.figures import figures
from rotordx.orchestrator.reproduction.ren.rotor_losses import Accuracy, losses, repeated, state_errors
from rotordx.orchestrator.scenario import Scenario, load_scenario

CITATION = "X.-L. Ren, Observer Design for Actuator Failure of a Quadrotor, IEEE Access 8, 18 August 2020"

Array = NDArray[np.float64]

VEHICLE = "ren_plus"
DIAGNOSERS = ("hinf", "hinf_tau3", "fast_adaptive", "fast_adaptive_quiet")

#: As printed in section IV.
PRINTED_LIPSCHITZ = 0.3
PRINTED_E2 = 0.3e-5

#: s, after which the healthy offset is known
CALIBRATED = 5.0

#: what counts as estimated accurately: of a loss, and of scenario B
SMALL_BIAS, SMALL_RMS = 0.003, 0.010


def reproduce(seeds: int, progress: Progress) -> Reproduction:
    """Fly scenarios A and B with and without noise, and check what can be calculated."""
    done, total = 0, 2 * seeds + 3
    first: dict[str, Recording] = {}

    def flown(recording: Recording) -> None:
        nonlocal done
        first.setdefault(recording.scenario["name"], recording)
        done += 1
        progress(done / total)

    a, b = _scenario("ren_scenario_a"), _scenario("ren_scenario_b")
    proportional = repeated(a, DIAGNOSERS, seeds, flown)
    varying = repeated(b, DIAGNOSERS, seeds, flown)
    quiet = repeated(a.changed(sensor_noise=False), DIAGNOSERS, 1, flown)
    quiet_varying = repeated(b.changed(sensor_noise=False), DIAGNOSERS, 1, flown)
    still = fly(a.changed(faults=[], sensor_noise=False))
    flown(still)
    noisy_a, noisy_b = first[a.name], first[b.name]
    claims = [
        *_claims_about_faults(proportional, quiet, varying, quiet_varying),
        *_claims_about_states(noisy_a, noisy_b),
        *_claims_about_uncertainty(proportional["hinf"], still),
        *_claims_about_conditions(noisy_a),
    ]
    verdict = (
        "An H-infinity observer does what the paper says it does, but not this one: its three matrix inequalities have "
        "no solution, and from attitude alone four rotor faults cannot be told apart. With one full Lyapunov matrix, "
        "the vertical velocity and sensor noise in the design, a loss of 30 % is estimated within 5 % after "
        f"{1000 * quiet['hinf'].settling_time:.0f} ms. A constant disturbance is not rejected, it is estimated "
        "as a fault, and has to be taken from a healthy window."
    )
    return Reproduction(CITATION, verdict, claims, list(figures(noisy_a, noisy_b, still)))


def _scenario(name: str) -> Scenario:
    """An experiment with both models of hinf and the baseline side by side, and the baseline as quiet as tau3."""
    scenario = load_scenario(name)
    baseline, tau3 = _design("fast_adaptive"), _design("hinf")
    quieter = _noise(tau3, "tau3") / _noise(baseline, "torques")
    learning_rate = (quieter * baseline["parameters"]["learning_rate"]).tolist()
    others = {
        "hinf_tau3": {"fmu": "hinf", "parameters": {"fault_model": "tau3"}},
        "fast_adaptive_quiet": {"fmu": "fast_adaptive", "parameters": {"learning_rate": learning_rate}},
    }
    return scenario.changed(components=scenario.plain()["components"] | others, diagnosers=list(DIAGNOSERS))


def _design(diagnoser: str) -> dict[str, Any]:
    design = load_design(VEHICLE, diagnoser)
    assert design is not None, f"{diagnoser} has no design for {VEHICLE}"
    return design


def _noise(design: dict[str, Any], certificate: str) -> Array:
    """Standard deviations of the estimates by the sensors' noise, as designed."""
    return np.array(next(c["figures"]["noise_std"] for c in design["certificates"] if c["name"] == certificate))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _claims_about_faults(
    proportional: dict[str, Accuracy],
    quiet: dict[str, Accuracy],
    varying: dict[str, Accuracy],
    quiet_varying: dict[str, Accuracy],
) -> Iterator[Claim]:
    a, q = proportional["hinf"], quiet["hinf"]
    yield Claim(
        "30 % of rotor 1 from 40 s (figure 3)",
        "can successfully estimate the actuator fault",
        f"without noise {q.text()}; with noise bias {a.bias:+.4f}, spread {a.std:.4f}, others at most {a.ghost:.4f}",
        bool(max(abs(a.bias), a.ghost, abs(q.bias), q.ghost) <= SMALL_BIAS),
        "with motor lag, of which the paper has none",
    )
    for pair, remark in (
        (("hinf_tau3", "fast_adaptive"), "both designed for the same noise and rates of change of the faults"),
        (("hinf_tau3", "fast_adaptive_quiet"), "the learning rate lowered until noise is as designed for tau3"),
        (("hinf", "fast_adaptive"), "vz4 does not assume that one rotor fails; v_z, which that takes, is slowest"),
    ):
        one, other = (f"{n} {1000 * quiet[n].settling_time:.0f} ms, {proportional[n].std:.4f}" for n in pair)
        faster = quiet[pair[0]].settling_time <= quiet[pair[1]].settling_time
        yield Claim(
            "speed and spread against [15]",
            "higher estimation speed and accuracy",
            f"{one}; {other}",
            bool(faster and proportional[pair[0]].std < proportional[pair[1]].std),
            f"{remark}; [15] is reconstructed",
        )
    b, q, base = varying["hinf"], quiet_varying["hinf"], varying["fast_adaptive"]
    yield Claim(
        "time-varying fault of rotor 1 (figure 5)",
        "the proposed method is also valid",
        f"rms error {b.rms:.4f} with noise, {q.rms:.4f} without; fast_adaptive {base.rms:.4f} with noise",
        bool(b.rms <= SMALL_RMS and b.rms < base.rms),
        "where the printed loss is below 0 (down to -0.0016 at 19 s) it is flown as 0",
    )


def _claims_about_states(a: Recording, b: Recording) -> Iterator[Claim]:
    onset = a.faults[0]["onset_s"]
    text, holds = [], True
    for part, when in (("before", (a.time > CALIBRATED) & (a.time < onset)), ("after", a.time >= onset)):
        error, noise = state_errors(a, "hinf")[when], _sensor_errors(a)[when]
        text.append(f"{part} the fault {_rms(error[:, :3]):.5f} rad, {_rms(error[:, 3:]):.4f} rad/s")
        holds = holds and _rms(error[:, :3]) < _rms(noise[:, :3]) and _rms(error[:, 3:]) < _rms(noise[:, 3:])
    whole = _sensor_errors(a)
    yield Claim(
        "attitude and rates with a proportional fault (figure 4)",
        "accurately estimates the state before and after the failure",
        f"rms errors {', '.join(text)}",
        bool(holds),
        f"the sensors' own errors are {_rms(whole[:, :3]):.5f} rad and {_rms(whole[:, 3:]):.4f} rad/s",
    )
    one, other = (_rms(state_errors(b, name)[b.time > CALIBRATED, :3]) for name in ("hinf", "fast_adaptive"))
    yield Claim(
        "attitude under the time-varying fault (figure 6)",
        "better estimation performance than [15]",
        f"rms error {one:.5f} rad, fast_adaptive {other:.5f} rad",
        bool(one < other),
    )


def _sensor_errors(recording: Recording) -> Array:
    """Measured less true attitude and rates (N, 6)."""
    signals = recording.signals
    return np.hstack([signals[f"sensors.{name}"] - signals[f"plant.{name}"] for name in ("euler", "body_rate")])


def _claims_about_uncertainty(a: Accuracy, still: Recording) -> Iterator[Claim]:
    raw = still.signals["hinf.fault_estimate"][still.time > CALIBRATED].mean(axis=0)
    left = losses(still, "hinf")[still.time > CALIBRATED].mean(axis=0)
    yield Claim(
        "constant disturbance d = [0.5, -0.5, 0.5] rad/s2",
        "fault and state are estimated in the presence of external disturbances",
        f"faults of {', '.join(f'{v:+.3f}' for v in raw)} in a healthy flight; {np.abs(left).max():.4f} at most beyond "
        "the mean of a healthy window",
        False,
        "a constant is not in L2, where (53) speaks; it enters as a fault B^-1 d does, and nothing tells them apart",
    )
    yield Claim(
        "parameter uncertainty, as it can be flown",
        "considered",
        f"moments of inertia 15 % smaller than designed for: bias {a.bias:+.4f}",
        bool(abs(a.bias) <= SMALL_BIAS),
        "E2 is 17.5 % of L k_l / I_x; E1 is at most 0.02 rad/s2 here",
    )
    forced = PRINTED_E2 * float((flight_model(load_vehicle(VEHICLE)).hover_speed ** 2).sum())
    yield Claim(
        "parameter uncertainty, as printed",
        "H = [1 ... 1], E2 = 0.3e-5 [1 ... 1], F = sin t",
        f"{forced:.1f} sin t rad/s on every Euler angle in hover: {forced * (1 - np.cos(0.5)):.1f} rad within 0.5 s",
        False,
        "no actuator acts on those rows; E2 also has six elements for four rotors",
    )


def _claims_about_conditions(a: Recording) -> Iterator[Claim]:
    squared = PRINTED_LIPSCHITZ**2
    for condition, paper, ours, remark in (
        ("(32)", "P, Q, Y1, Y2", f"{squared:.2f}", "the block L_f^2 I, which no variable is in"),
        ("(42)", "P, Q, Y1, Y2", f"{1 + squared:.2f}", "the block (L_f^2 + 1) I"),
        ("(57)", "P, Q, Y1, Y2, epsilon", f"{1 + squared:.2f}", "(42) is in it, and zeros where -epsilon I belongs"),
    ):
        yield Claim(
            f"matrix inequality {condition}",
            f"{paper} are found with the LMI toolbox",
            f"none: the largest eigenvalue is {ours} at least",
            False,
            f"{remark}; here one full P over state and fault, noise as an input: gains/README.md",
        )
    vehicle = load_vehicle(VEHICLE)
    model = fault_models.rotor_faults_from_attitude(vehicle, hinf.Options())
    hidden = undetectable_directions(model.A[0], model.C)
    size = len(model.states)
    yield Claim(
        "four rotor faults from attitude and rates",
        "estimated (assumption 2)",
        f"rank {size - hidden.shape[1]} of {size}: the direction {_direction(hidden[model.faults, 0])} is undetectable",
        False,
        "rotordx design hinf --vehicle ren_plus --set 'models=[\"attitude4\"]' refuses it; vz4 measures v_z, tau3 "
        "estimates three torques",
    )
    largest = _lipschitz_in_flight(a)
    yield Claim(
        "Lipschitz constant of f(x), 1/s",
        f"L_f = {PRINTED_LIPSCHITZ}",
        f"{largest:.2f} at most along flight A",
        bool(largest <= PRINTED_LIPSCHITZ),
        f"certified here: {attitude_lipschitz(vehicle, hinf.Options()):.2f}, over tilts of 20 degrees and rates of "
        "2 rad/s, with exact kinematics",
    )
    yield Claim(
        "sign of the yaw torque",
        "(8): k_g (w1^2 - w2^2 + w3^2 - w4^2); (16): -k_g, k_g, -k_g, k_g",
        "the two contradict each other; (8) is flown, which (10) agrees with",
        False,
        "with the last row of D as printed, yaw would be driven the wrong way",
    )


def _direction(faults: Array) -> str:
    return "[" + ", ".join(f"{v:g}" for v in np.round(faults / faults[np.abs(faults).argmax()], 3)) + "]"


def _lipschitz_in_flight(recording: Recording) -> float:
    """Largest norm of the Jacobian of f, (21), in the body rates along a flight, 1/s."""
    vehicle: Any = load_vehicle(VEHICLE).fill(VehicleParameters)
    rate, speed = ca.SX.sym("rate", 3), ca.SX.sym("speed", 4)
    acceleration = coupling_torque(rate, speed, vehicle) / vehicle.inertia
    jacobian = ca.Function("jacobian", [rate, speed], [ca.jacobian(acceleration, rate)])
    rates, speeds = recording.signals["plant.body_rate"], recording.signals["esc.rotor_speed"]
    found = np.array(jacobian.map(len(rates))(rates.T, speeds.T)).reshape(3, -1, 3).transpose(1, 0, 2)
    return float(np.linalg.norm(found, 2, axis=(1, 2)).max())
