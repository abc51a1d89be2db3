"""Augmented-state Kalman filter of vehicle states and four rotor losses.

Comparison method of "Fault Diagnosis for Quadcopter UAVs Based on Fault Occurrence Degree"; the README has its
equations and every deviation from them. The filter is in `../kalman.py`, its model of a vehicle in
`../rotor_losses.py`.
"""

from __future__ import annotations

from casadi import SX, diagcat, if_else, sqrt

from rotordx.fmus.diagnosers import kalman
from rotordx.fmus.diagnosers.interface import Clock, Command, Measured, rows, select
from rotordx.fmus.diagnosers.rotor_losses import (
    LOSS_COUNT,
    STATE_COUNT,
    FilterOutputs,
    FilterParameters,
    VehicleState,
    diagnose,
    first_estimate,
    known_interval,
    measurement,
    step_model,
)
from rotordx.fmus.shell.ports import Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

SIZE = STATE_COUNT + LOSS_COUNT


@ports
class Parameters(FilterParameters):
    """Noise, detection, and the steady gain."""

    kalman_gain: Vector = port(
        "1", "steady K in hover by rows: states, losses; columns v_z, p, q, r", start=(0,) * (4 * SIZE)
    )


@ports
class AugmentedState:
    """Estimate and covariance of [x; gamma]."""

    state_estimate: Vector = port("m/s, rad/s, m, m/s, 1", "x", start=(0,) * STATE_COUNT)
    loss_estimate: Vector = port("1", "gamma", start=(0,) * LOSS_COUNT)
    covariance: Vector = port("1", "P, upper triangle by columns", start=(0,) * (SIZE * (SIZE + 1) // 2))


@ports
class State(VehicleState, AugmentedState):
    """Filter, vehicle and verdict."""


@ports
class Outputs(FilterOutputs):
    """Those of both filters."""


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the filter over the step that ends now, then the verdict."""
    interval = known_interval(measured, command, state, vehicle, clock.dt)
    model = step_model(interval, parameters, vehicle, clock.dt)
    before, y = _unpacked(state), measurement(measured)
    optimal, innovation = kalman.augmented_step(before, model, y)
    gain = rows(parameters.kalman_gain, LOSS_COUNT)
    steady, error = kalman.fixed_augmented_step(before, model, y, gain)
    fixed = parameters.fixed_gain

    first, first_covariance = first_estimate(measured, parameters, vehicle)
    start = AugmentedState(
        state_estimate=first,
        loss_estimate=SX(LOSS_COUNT, 1),
        covariance=kalman.pack(diagcat(first_covariance, SX.eye(LOSS_COUNT) * parameters.initial_loss_variance)),
    )
    after = AugmentedState(
        state_estimate=if_else(fixed, steady.state, optimal.state),
        loss_estimate=if_else(fixed, steady.loss, optimal.loss),
        covariance=kalman.pack(optimal.covariance),
    )
    filtered = select(state.started, after, start)
    normalised = state.started * if_else(fixed, error, innovation.error) / sqrt(innovation.variance)
    vehicle_state, outputs = diagnose(_unpacked(filtered), normalised, measured, interval, state, parameters, clock)
    return State(**vars(filtered), **vars(vehicle_state)), Outputs(**vars(outputs))


def _unpacked(state: AugmentedState) -> kalman.Augmented:
    return kalman.Augmented(state.state_estimate, state.loss_estimate, kalman.unpack(state.covariance, SIZE))
