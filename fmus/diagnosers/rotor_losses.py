"""What `askf` and `msjfo` share on a vehicle: the model of a step with four rotor losses, its noise, and the verdict.

States: v_z, p, q, r; what the velocity filter makes of v_z (two states); the thrust that each rotor lacks. A loss
gamma_i takes gamma_i u_i from the thrust that is commanded, behind the motor lag: E = -B diag(u). Thrusts are relative
to the mean one in hover.

The filter F = w0^2 / (s + w0)^2 of (33) in paper 000 makes the vertical velocity of the captured position. Noise enters
there, upstream: it is coloured when v_z is measured, white for a model that contains the filter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan

from casadi import SX, diag, exp, fmax, if_else, jacobian, mmax, mmin, repmat, sqrt, sum1, vertcat, vertsplit

from rotordx.fmus.diagnosers import kalman
from rotordx.fmus.diagnosers.interface import Clock, Command, DiagnosisOutputs, Measured, hold_filter, lagged_speed
from rotordx.fmus.diagnosers.single_rotor import DecisionParameters, DecisionState, calibrated, decide, exceeds_margin
from rotordx.fmus.model_terms.terms import allocation, fault_signatures, input_gain, rate_dynamics
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

STATES: tuple[str, ...] = (
    "v_z",
    "p",
    "q",
    "r",
    "position_lag",
    "filtered_velocity",
    "thrust_1",
    "thrust_2",
    "thrust_3",
    "thrust_4",
)
STATE_COUNT, LOSS_COUNT = len(STATES), 4

#: states that are measured, in the order of the channels v_z, p, q, r
MEASURED_STATES = (5, 1, 2, 3)

#: m/s: standard deviation of the vertical velocity that the first sample leaves open
START_VELOCITY_STD = 0.1


@ports
class FilterParameters(DecisionParameters):
    """Noise as the filter has it, its steady gain is the diagnoser's own; then detection."""

    velocity_filter_bandwidth: Scalar = port("rad/s", "w0 of the velocity filter", start=20.0, minimum=1e-3)
    acceleration_noise_density: Vector = port(
        "m2/s3, rad2/s3", "growth of the variances of v_z, p, q, r by white accelerations", (1e-4,) * 4, minimum=0
    )
    thrust_noise_density: Scalar = port("1/s", "the same of a rotor's relative thrust", 1e-6, minimum=0)
    loss_noise_density: Scalar = port("1/s", "the same of a loss: Q_gamma per second", 1e-5, minimum=0)
    position_noise_density: Scalar = port("m2.s", "of the vertical position before the filter", 4e-8, minimum=0)
    measurement_noise_variance: Vector = port(
        "m2/s2, rad2/s2", "R: of one sample of v_z behind its filter, p, q, r", (1e-7, 4e-4, 4e-4, 4e-4), minimum=1e-12
    )
    initial_loss_variance: Scalar = port("1", "of each loss at the first sample", 0.01, minimum=1e-12)
    fixed_gain: Scalar = port("1", "on: the steady gain of hover, not that of the covariances", choices=("off", "on"))
    common_mode: Scalar = port(
        "1", "removed: losses count from their median, and v_z does not count", start=1, choices=("kept", "removed")
    )
    detection_quantile: Scalar = port(
        "1", "standard deviations of the estimate that are added to margin", start=4.5, minimum=0
    )


@ports
class VehicleState(DecisionState):
    """What is known without the filter, what its innovations were in the healthy window, and the verdict."""

    started: Scalar = port("1", "0 until the first sample")
    rotor_speed: Vector = port("rad/s", "commanded speed after the nominal motor lag", start=(0,) * 4)
    body_rate: Vector = port("rad/s", "previous sample", start=(0,) * 3)
    innovation_ratio: Vector = port("1", "mean normalised innovation squared in the healthy window", start=(0,) * 4)


@ports
class FilterOutputs(DiagnosisOutputs):
    """What both filters say; channels are v_z, p, q, r."""

    residual: Vector = port("m/s2, rad/s2", "effect of the losses less healthy offsets: v_z, p, q, r", start=(0,) * 4)
    threshold: Vector = port("m/s2, rad/s2", "a fault is detected when |residual| exceeds it", start=(nan,) * 4)
    loss_estimate: Vector = port("1", "gamma: loss of effectiveness of each rotor, offsets included", start=(0,) * 4)
    loss_deviation: Vector = port("1", "the same less offset, and less the common mode if removed", start=(0,) * 4)
    loss_covariance: Vector = port("1", "of loss_estimate, upper triangle by columns", start=(0,) * 10)
    state_estimate: Vector = port(
        "m/s, rad/s, m, m/s, 1", "v_z, p, q, r, lag of the filtered position, filtered v_z, lacking thrusts", (0,) * 10
    )
    state_variance: Vector = port("m2/s2, rad2/s2, m2, m2/s2, 1", "of state_estimate", start=(0,) * 10)
    normalised_innovation: Vector = port(
        "1", "what v_z, p, q, r each add to those before, in standard deviations", start=(0,) * 4
    )
    innovation_ratio: Vector = port(
        "1", "mean square of them in the healthy window; 1 if the noise is as assumed", start=(0,) * 4
    )
    acceleration_fault: Vector = port("m/s2, rad/s2", "acceleration of v_z, p, q, r by loss_estimate", start=(0,) * 4)
    common_mode_removed: Scalar = port("1", "1 if losses count from their median")
    common_mode_loss: Scalar = port("1", "median of the losses less their offsets")


@dataclass(frozen=True)
class Interval:
    """What is known of the step that ends now without any estimate."""

    acceleration: Vector  #: (4) of v_z, p, q, r by gravity, healthy rotors and coupling, mean over the step
    effect: Vector  #: (4, 4) acceleration of the channels by a rotor's thrust of 1
    thrust: Vector  #: (4) u, commanded
    rotor_speed: Vector  #: (4) rad/s at the end of the step
    signatures: Vector  #: (4, 4) columns h_s, what the total loss of each rotor adds to the channels


def known_interval(
    measured: Measured, command: Command, state: VehicleState, vehicle: VehicleParameters, dt: Scalar
) -> Interval:
    """Known part of the step: means of its two ends, save for Euler angles, which are held between captures."""
    speed_before, speed = lagged_speed(state.started, state.rotor_speed, command, vehicle, dt)
    rate_before = if_else(state.started, state.body_rate, measured.body_rate)
    mean_speed, mean_rate = (speed_before + speed) / 2, (rate_before + measured.body_rate) / 2
    unit = vehicle.mass * vehicle.gravity / sum1(vehicle.thrust_coefficient)  # mean squared speed in hover, rad2/s2
    return Interval(
        acceleration=rate_dynamics(vertcat(0, mean_rate), measured.euler, mean_speed, vehicle),
        effect=input_gain(measured.euler, vehicle) @ allocation(vehicle) * unit,
        thrust=command.rotor_speed_command**2 / unit,
        rotor_speed=speed,
        signatures=fault_signatures(measured.euler, mean_speed, vehicle),
    )


def transition(
    state: Vector,
    loss: Vector,
    position_noise: Scalar,
    interval: Interval,
    bandwidth: Scalar,
    vehicle: VehicleParameters,
    dt: Scalar,
) -> Vector:
    """States (10) after a step; affine in states, losses (4) and noise of the captured position (m), which is held.

    Motor lag and velocity filter are exact; each is driven by the mean over the step of what is before it.
    """
    v_z, rates, lag, filtered, lacking = vertsplit(state, [0, 1, 4, 5, 6, 10])
    decay, hold = hold_filter(1 / vehicle.motor_time_constant, dt)
    wanted = -interval.thrust * loss
    mean_lacking = wanted + hold / dt * (lacking - wanted)
    acceleration = interval.acceleration + interval.effect @ mean_lacking
    drag = vehicle.drag_coefficient / vehicle.mass * dt / 2  # of the mean velocity
    v_z_after = ((1 - drag) * v_z + dt * acceleration[0]) / (1 + drag)

    velocity = (v_z + v_z_after) / 2
    settled = velocity / bandwidth - position_noise
    fade = exp(-bandwidth * dt)
    slope = bandwidth**2 * (lag - settled)
    return vertcat(
        v_z_after,
        rates + dt * acceleration[1:],
        settled + fade * (lag - settled),
        velocity + fade * (filtered - velocity + dt * slope),
        wanted + decay * (lacking - wanted),
    )


def step_model(
    interval: Interval, parameters: FilterParameters, vehicle: VehicleParameters, dt: Scalar
) -> kalman.Model:
    """One step as both filters take it."""
    x, gamma, noise = SX.sym("x", STATE_COUNT), SX.sym("gamma", LOSS_COUNT), SX.sym("noise")
    after = transition(x, gamma, noise, interval, parameters.velocity_filter_bandwidth, vehicle, dt)
    none = SX(STATE_COUNT, 1), SX(LOSS_COUNT, 1), SX(0)
    noise_input = jacobian(after, noise)
    walks = vertcat(
        parameters.acceleration_noise_density, SX(2, 1), repmat(parameters.thrust_noise_density, LOSS_COUNT, 1)
    )
    return kalman.Model(
        transition=jacobian(after, x),
        drive=transition(*none, interval, parameters.velocity_filter_bandwidth, vehicle, dt),
        loss_input=jacobian(after, gamma),
        measurement=SX.eye(STATE_COUNT)[MEASURED_STATES, :],
        process_noise=diag(walks) * dt + noise_input @ noise_input.T * (parameters.position_noise_density / dt),
        loss_noise=SX.eye(LOSS_COUNT) * (parameters.loss_noise_density * dt),
        measurement_noise=parameters.measurement_noise_variance,
    )


def measurement(measured: Measured) -> Vector:
    """v_z, p, q, r as measured (4)."""
    return vertcat(measured.vertical_velocity, measured.body_rate)


def first_estimate(measured: Measured, parameters: FilterParameters, vehicle: VehicleParameters) -> tuple[Vector, SX]:
    """States (10) at the first sample, with their covariance (10, 10): velocity steady, rotors healthy."""
    v_z, bandwidth = measured.vertical_velocity, parameters.velocity_filter_bandwidth
    state = vertcat(v_z, measured.body_rate, v_z / bandwidth, v_z, SX(LOSS_COUNT, 1))
    variance, velocity = parameters.measurement_noise_variance, START_VELOCITY_STD**2
    walking = parameters.thrust_noise_density * vehicle.motor_time_constant / 2  # of a thrust that always has
    variances = vertcat(velocity, variance[1:], velocity / bandwidth**2, variance[0], repmat(walking, LOSS_COUNT, 1))
    return state, diag(variances)


def diagnose(
    estimate: kalman.Augmented | kalman.Staged,
    normalised_innovation: Vector,
    measured: Measured,
    interval: Interval,
    state: VehicleState,
    parameters: FilterParameters,
    clock: Clock,
) -> tuple[VehicleState, FilterOutputs]:
    """From estimated losses to a verdict.

    The threshold of a channel is `margin`, what the declared accelerations of a healthy vehicle do to its estimate,
    and the quantile times the standard deviation that follows from the covariance. If the innovations of a measurement
    were larger in the healthy window than the covariance has them, the standard deviation grows as they did.
    """
    calibration, loss_deviation, armed = calibrated(estimate.loss, state.started, state, parameters, clock)
    share = if_else(calibration.offset_samples > state.offset_samples, 1 / fmax(calibration.offset_samples, 1), 0)
    innovation_ratio = state.innovation_ratio + share * (normalised_innovation**2 - state.innovation_ratio)

    common = (sum1(loss_deviation) - mmax(loss_deviation) - mmin(loss_deviation)) / 2
    removed = parameters.common_mode
    loss_deviation = loss_deviation - if_else(removed, common, 0)
    h = interval.signatures
    counted = vertcat(1 - removed, 1, 1, 1)
    deviation = counted * (h @ loss_deviation)
    variance = vertcat(*(h[i, :] @ estimate.loss_covariance @ h[i, :].T for i in range(4)))
    std = sqrt(variance * fmax(1, mmax(innovation_ratio)))
    threshold = parameters.margin + parameters.detection_quantile * std
    with_noise = replace(parameters, margin=threshold)
    exceeds = exceeds_margin(deviation, with_noise)
    verdict_state, verdict = decide(exceeds, deviation, armed, diag(counted) @ h, state, with_noise, clock)
    after = VehicleState(
        **vars(calibration),
        **vars(verdict_state),
        started=1,
        rotor_speed=interval.rotor_speed,
        body_rate=measured.body_rate,
        innovation_ratio=innovation_ratio,
    )
    outputs = FilterOutputs(
        **vars(verdict),
        residual=deviation,
        threshold=if_else(armed, threshold, nan),
        loss_estimate=estimate.loss,
        loss_deviation=loss_deviation,
        loss_covariance=kalman.pack(estimate.loss_covariance),
        state_estimate=estimate.state,
        state_variance=diag(estimate.state_covariance),
        normalised_innovation=normalised_innovation,
        innovation_ratio=innovation_ratio,
        acceleration_fault=h @ estimate.loss,
        common_mode_removed=removed,
        common_mode_loss=common,
    )
    return after, outputs
