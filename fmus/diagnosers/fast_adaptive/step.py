"""Fast adaptive estimator of torque faults, the baseline of Ren 2020 as reconstructed here.

    x_hat' = A x_hat + p(x_hat, u) + B (u + f_hat) - L e_y,    f_hat' = -Gamma F (e_y' + sigma e_y),    e_y = y_hat - y

Integrated, f_hat = -Gamma F (e_y + sigma integral e_y) needs no derivative. The README says where it comes from.
"""

from __future__ import annotations

from math import nan

from casadi import if_else, vertcat

from rotordx.fmus.diagnosers.attitude_observer import (
    ObserverOutputs,
    ObserverState,
    interval,
    model,
    observer_outputs,
    observer_state,
    torque_signatures,
)
from rotordx.fmus.diagnosers.interface import Clock, Command, DiagnosisOutputs, Measured, rows, runge_kutta
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class GainParameters:
    """Closed forms, proved by gains/fast_adaptive.py."""

    observer_gain: Vector = port("1/s", "L, 6x6 by rows: roll, pitch, yaw, p, q, r", start=(0,) * 36)
    fault_gain: Vector = port("1/(kg.m2)", "F = B^T P, 3x6 by rows", start=(0,) * 18)
    learning_rate: Vector = port("kg2.m4/s", "diagonal of Gamma", start=(0,) * 3, minimum=0)
    integral_rate: Scalar = port("1/s", "sigma", start=50.0, minimum=0)


@ports
class Parameters(DecisionParameters, GainParameters):
    """Estimator, decision (dataclass fields of the last base lead)."""


@ports
class State(DecisionState, ObserverState):
    """Observer, decision, integral."""

    integral: Vector = port("rad/(kg.m2), rad/(kg.m2.s)", "integral of F e_y", start=(0,) * 3)


@ports
class Outputs(ObserverOutputs, DiagnosisOutputs):
    """Common outputs, state and fault, residual (dataclass fields of the last base lead)."""

    residual: Vector = port("m/s2, rad/s2", "acceleration_fault less its healthy mean: v_z, p, q, r", start=(0,) * 4)
    threshold: Vector = port("m/s2, rad/s2", "margin of the residual, NaN until calibrated", start=(nan,) * 4)


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the estimator over the step that ends now, then the verdict at its end."""
    known = interval(measured, command, state, vehicle, clock.dt)
    L, F = rows(parameters.observer_gain, 6), rows(parameters.fault_gain, 6)

    def fault(error: Vector, integral: Vector) -> Vector:
        return -parameters.learning_rate * (F @ error + parameters.integral_rate * integral)

    def derivative(z: Vector, share: float) -> Vector:
        y, estimate, integral = known.measured(share), z[:6], z[6:]
        error = estimate - y
        by_fault = vertcat(0, 0, 0, fault(error, integral) / vehicle.inertia)
        seen = vertcat(y[:3], estimate[3:])  # the attitude is measured, see the README
        return vertcat(model(seen, known.rotor_speed(share), vehicle) + by_fault - L @ error, F @ error)

    start = vertcat(known.estimate, state.integral)
    z = if_else(state.started, runge_kutta(derivative, start, clock.dt), start)
    acceleration = vertcat(0, fault(z[:6] - known.measurement, z[6:]) / vehicle.inertia)

    calibration, deviation, armed = calibrated(acceleration, state.started, state, parameters, clock)
    exceeds = exceeds_margin(deviation, parameters)
    signatures = torque_signatures(known, vehicle)
    verdict_state, verdict = decide(exceeds, deviation, armed, signatures, state, parameters, clock)

    observer = observer_state(z[:6], known)
    outputs = Outputs(
        **vars(verdict),
        **vars(observer_outputs(observer, acceleration, verdict, known, vehicle)),
        residual=deviation,
        threshold=if_else(armed, parameters.margin, nan),
    )
    return State(**vars(observer), **vars(calibration), **vars(verdict_state), integral=z[6:]), outputs
