"""Multi-stage joint fault observer: bias-free filter of the states, filter of the rotor losses, coupling of both.

"Fault Diagnosis for Quadcopter UAVs Based on Fault Occurrence Degree"; the README has its equations and every deviation
from them. The filter is in `../kalman.py`, its model of a vehicle in `../rotor_losses.py`.
"""

from __future__ import annotations

from casadi import SX, if_else

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


@ports
class Parameters(FilterParameters):
    """Noise, detection, and the steady gain of the bias-free stage."""

    bias_free_gain: Vector = port(
        "1", "steady K~ in hover by rows: states; columns v_z, p, q, r", start=(0,) * (4 * STATE_COUNT)
    )
    bias_free_innovation_variance: Vector = port(
        "m2/s2, rad2/s2", "diagonal of the steady S~ in hover", start=(1,) * 4, minimum=1e-12
    )


@ports
class StagedState:
    """Estimates of both stages, and their coupling."""

    bias_free_state: Vector = port("m/s, rad/s, m, m/s, 1", "x~", start=(0,) * STATE_COUNT)
    bias_free_covariance: Vector = port(
        "1", "P~, upper triangle by columns", start=(0,) * (STATE_COUNT * (STATE_COUNT + 1) // 2)
    )
    loss_estimate: Vector = port("1", "gamma", start=(0,) * LOSS_COUNT)
    loss_covariance: Vector = port("1", "P_gamma, upper triangle by columns", start=(0,) * 10)
    coupling: Vector = port("m/s, rad/s, m, m/s, 1", "V by columns: x = x~ + V gamma", start=(0,) * 40)


@ports
class State(VehicleState, StagedState):
    """Filter, vehicle and verdict."""


@ports
class Outputs(FilterOutputs):
    """Those of both filters, and the bias-free estimate."""

    bias_free_state_estimate: Vector = port(
        "m/s, rad/s, m, m/s, 1", "x~: state_estimate if there were no losses", start=(0,) * STATE_COUNT
    )


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: the filter over the step that ends now, then the verdict."""
    interval = known_interval(measured, command, state, vehicle, clock.dt)
    model = step_model(interval, parameters, vehicle, clock.dt)
    before, y = _unpacked(state), measurement(measured)
    optimal, innovation = kalman.staged_step(before, model, y)
    gain = rows(parameters.bias_free_gain, LOSS_COUNT)
    held, held_innovation = kalman.fixed_staged_step(before, model, y, gain, parameters.bias_free_innovation_variance)
    fixed = parameters.fixed_gain

    first, first_covariance = first_estimate(measured, parameters, vehicle)
    start = kalman.Staged(
        bias_free_state=first,
        bias_free_covariance=first_covariance,
        loss=SX(LOSS_COUNT, 1),
        loss_covariance=SX.eye(LOSS_COUNT) * parameters.initial_loss_variance,
        coupling=SX(STATE_COUNT, LOSS_COUNT),
    )
    after = select(fixed, _packed(held), _packed(optimal))
    filtered = select(state.started, after, _packed(start))
    staged = _unpacked(filtered)
    normalised = state.started * if_else(fixed, held_innovation.normalised, innovation.normalised)
    vehicle_state, outputs = diagnose(staged, normalised, measured, interval, state, parameters, clock)
    return (
        State(**vars(filtered), **vars(vehicle_state)),
        Outputs(**vars(outputs), bias_free_state_estimate=staged.bias_free_state),
    )


def _packed(staged: kalman.Staged) -> StagedState:
    return StagedState(
        bias_free_state=staged.bias_free_state,
        bias_free_covariance=kalman.pack(staged.bias_free_covariance),
        loss_estimate=staged.loss,
        loss_covariance=kalman.pack(staged.loss_covariance),
        coupling=staged.coupling.reshape((STATE_COUNT * LOSS_COUNT, 1)),
    )


def _unpacked(state: StagedState) -> kalman.Staged:
    return kalman.Staged(
        bias_free_state=state.bias_free_state,
        bias_free_covariance=kalman.unpack(state.bias_free_covariance, STATE_COUNT),
        loss=state.loss_estimate,
        loss_covariance=kalman.unpack(state.loss_covariance, LOSS_COUNT),
        coupling=state.coupling.reshape((STATE_COUNT, LOSS_COUNT)),
    )
