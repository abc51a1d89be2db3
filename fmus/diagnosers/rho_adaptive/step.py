"""Robust adaptive detection and estimation with switching rho-modification (paper 003, Theorems 1 and 2).

Detection first, with theta_hat = 0; the adaptive law starts at detection. Before, while the healthy vehicle is
calibrated, it runs as well: the mean acceleration that it finds is known from then on.
"""

from __future__ import annotations

from math import nan

from casadi import if_else, logic_and, logic_not, logic_or

from rotordx.fmus.diagnosers.interface import Clock, Command, DiagnosisOutputs, Measured, rows
from rotordx.fmus.diagnosers.known_acceleration import KnownParameters, KnownState, known_acceleration
from rotordx.fmus.diagnosers.rho_adaptive.estimator import AdaptationParameters, advance_estimator, inverse
from rotordx.fmus.diagnosers.rho_adaptive.evaluation import EvaluationParameters, EvaluationState, evaluate
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class ObserverParameters:
    """Gain of the observer."""

    observer_gain: Vector = port(
        "1/s",
        "P, 4x4 by rows: v_z, p, q, r (gains/rho_adaptive.py)",
        start=[18.0 * (i % 5 == 0) for i in range(16)],
    )


@ports
class Parameters(DecisionParameters, KnownParameters, EvaluationParameters, AdaptationParameters, ObserverParameters):
    """Observer, adaptive law, threshold, known model, decision (dataclass fields of the last base lead)."""


@ports
class ObserverState:
    """x_hat and theta_hat, and whether faults are looked for."""

    channel_estimate: Vector = port("m/s, rad/s", "x_hat: v_z, p, q, r", start=(0,) * 4)
    fault_estimate: Vector = port("1", "theta_hat: loss of effectiveness of each rotor", start=(0,) * 4)
    armed: Scalar = port("1", "1 once calibrated (latched)")


@ports
class State(DecisionState, EvaluationState, ObserverState, KnownState):
    """All of the parts."""


@ports
class Outputs(DiagnosisOutputs):
    """The common outputs, then residual evaluation and threshold, then the observer's."""

    residual: Vector = port("m/s, rad/s", "J_nu: rms of |nu| over T1", start=(0,))
    threshold: Vector = port("m/s, rad/s", "J_th of Theorem 1, NaN until calibrated", start=(nan,))
    output_error: Vector = port("m/s, rad/s", "nu: measured less estimated v_z, p, q, r", start=(0,) * 4)
    fault_estimate: Vector = port("1", "theta_hat: loss of each rotor, 0 between calibration and detection", (0,) * 4)
    acceleration_estimate: Vector = port(
        "m/s2, rad/s2", "unknown acceleration of v_z, p, q, r: healthy offset and phi theta_hat", start=(0,) * 4
    )
    channel_estimate: Vector = port("m/s, rad/s", "x_hat: v_z, p, q, r", start=(0,) * 4)


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the observer over the step that ends now, then the decisions at its end."""
    known_state, known = known_acceleration(measured, command, state, parameters, vehicle, clock)
    offset = if_else(state.armed, state.offset, 0)
    start = if_else(state.started, state.channel_estimate, known.after)
    channels, fault = advance_estimator(
        start,
        state.fault_estimate,
        logic_or(logic_not(state.armed), state.fault_detected),
        known.measured,
        lambda x: known.acceleration(x) + offset,
        known.signatures,
        inverse(known.signatures),
        rows(parameters.observer_gain, 4),
        parameters,
        clock.dt,
    )
    channels, fault = if_else(state.started, channels, known.after), if_else(state.started, fault, 0)

    estimate = offset + known.signatures @ fault
    calibration, deviation, armed = calibrated(estimate, state.started, state, parameters, clock)
    error = known.after - channels
    evaluation, residual, threshold = evaluate(error, armed, state, parameters, clock.dt)
    verdict, diagnosis = decide(residual > threshold, deviation, armed, known.signatures, state, parameters, clock)
    fault = if_else(logic_and(armed, logic_not(verdict.fault_detected)), 0, fault)  # adapts before and after only

    outputs = Outputs(
        **vars(diagnosis),
        residual=residual,
        threshold=if_else(armed, threshold, nan),
        output_error=error,
        fault_estimate=fault,
        acceleration_estimate=estimate,
        channel_estimate=channels,
    )
    own = vars(ObserverState(channels, fault, armed)) | vars(evaluation)
    return State(**vars(known_state), **own, **vars(calibration), **vars(verdict)), outputs
