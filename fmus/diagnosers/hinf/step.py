"""Robust H-infinity observer of state and actuator faults.

X.-L. Ren, "Observer Design for Actuator Failure of a Quadrotor", (24) with full gains: `observer.py`. The README has
every deviation from the paper.
"""

from __future__ import annotations

import dataclasses
from math import nan

from casadi import fmax, fmin, if_else, logic_and, mmax, solve, sum1, vertcat

from rotordx.fmus.diagnosers.hinf.observer import (
    MODELS,
    FaultObserverOutputs,
    FaultObserverState,
    GainParameters,
    advance_observer,
)
from rotordx.fmus.diagnosers.interface import ROTORS, Clock, Command, DiagnosisOutputs, Measured, latch
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class Parameters(DecisionParameters, GainParameters):
    """Observer, decision (dataclass fields of the last base lead)."""

    torque_margin: Vector = port("m/s2, rad/s2", "as margin, of tau3", (1,) * 4, minimum=0)
    torque_settling_time: Vector = port("s", "as settling_time, of tau3", (0, 0.05, 0.05, 0.05), minimum=0)
    rotor_loss_margin: Vector = port("1", "largest rotor_loss of a healthy vehicle in hover", (0.2,) * 4, minimum=0)


@ports
class LossState:
    """Which rotors have lost effectiveness, each judged by itself."""

    lost_since: Vector = port("s", "time since which a rotor's loss has exceeded its margin", start=(0,) * 4)
    rotor_lost: Vector = port("1", "latched", start=(0,) * 4)


@ports
class State(LossState, DecisionState, FaultObserverState):
    """Observer, decision, losses (dataclass fields of the last base lead)."""


@ports
class Outputs(FaultObserverOutputs, DiagnosisOutputs):
    """Common outputs, estimates, residual, then the losses of all four rotors."""

    residual: Vector = port("m/s2, rad/s2", "acceleration_fault less its healthy mean: v_z, p, q, r", start=(0,) * 4)
    threshold: Vector = port("m/s2, rad/s2", "margin of the residual, NaN until calibrated", start=(nan,) * 4)
    rotor_loss: Vector = port("1", "loss of effectiveness of each rotor that explains the residual", start=(0,) * 4)
    rotor_loss_threshold: Vector = port("1", "margin of rotor_loss at this speed, NaN until calibrated", (nan,) * 4)
    rotor_lost: Vector = port("1", "1 once rotor_loss has exceeded its margin for long (latched)", start=(0,) * 4)
    isolation_model: Scalar = port("1", "4: four independent rotor losses; 1: one rotor's loss is assumed")


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the observer over the step that ends now, then the verdict at its end."""
    four = parameters.fault_model == MODELS.index("vz4")
    estimate = advance_observer(measured, command, state, parameters, vehicle, clock.dt)
    decision = dataclasses.replace(
        parameters,
        margin=if_else(four, parameters.margin, parameters.torque_margin),
        settling_time=if_else(four, parameters.settling_time, parameters.torque_settling_time),
    )
    calibration, deviation, armed = calibrated(
        estimate.outputs.acceleration_fault, state.started, state, decision, clock
    )
    exceeds = exceeds_margin(deviation, decision)
    seen = vertcat(four * estimate.signatures[0, :], estimate.signatures[1:, :])
    verdict_state, verdict = decide(exceeds, deviation, armed, seen, state, decision, clock)

    # Four channels and four rotors: H theta = deviation.
    loss = solve(estimate.signatures, deviation)
    loss_margin = parameters.rotor_loss_margin * (parameters.hover_speed / estimate.rotor_speed) ** 2
    losses = _judged(loss > loss_margin, logic_and(four, armed), state, mmax(decision.settling_time), clock)
    others = sum1(losses.rotor_lost * (verdict.faulty_rotor != ROTORS))
    each = losses.rotor_lost * fmax(0, fmin(1, loss))
    outputs = Outputs(
        **(vars(verdict) | {"loe_estimate": if_else(others > 0, each, verdict.loe_estimate)}),
        **vars(estimate.outputs),
        residual=deviation,
        threshold=if_else(armed, decision.margin, nan),
        rotor_loss=if_else(four, loss, nan),
        rotor_loss_threshold=if_else(logic_and(four, armed), loss_margin, nan),
        rotor_lost=losses.rotor_lost,
        isolation_model=if_else(four, 4, 1),
    )
    return State(**vars(estimate.state), **vars(calibration), **vars(verdict_state), **vars(losses)), outputs


def _judged(exceeds: Vector, armed: Scalar, state: LossState, settling_time: Scalar, clock: Clock) -> LossState:
    """Latch a rotor whose loss has exceeded its margin for longer than the slowest channel takes to settle.

    Until then the channels do not belong together: a loss of one rotor looks like losses of several.
    """
    since = if_else(logic_and(armed, exceeds), state.lost_since, clock.time)
    lasting = clock.time - since > settling_time + clock.dt / 2
    return LossState(since, latch(state.rotor_lost, lasting))
