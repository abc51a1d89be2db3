"""Error models of a vehicle near hover: what an observer sees, and which faults it estimates.

Faults are dimensionless. A rotor fault is the missing part of a rotor's squared speed over its squared hover speed, so
that -0.2 is a loss of 20 % in hover; a torque fault is the same in units of the largest torque that one rotor's total
loss takes away in hover. Between faults that change at random and noise, an observer is a compromise; `fault_rate`
moves it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains.discretisation import INTEGRATORS
from rotordx.gains.error_model import ErrorModel
from rotordx.gains.flight_model import Envelope, attitude_lipschitz, flight_model, rate_lipschitz
from rotordx.gains.options import POSITIVE, option
from rotordx.gains.rounding import rounded, rounded_rows

Array = NDArray[np.float64]

ATTITUDE = ("roll", "pitch", "yaw")
RATES = ("p", "q", "r")
ROTOR_FAULTS = ("fault_1", "fault_2", "fault_3", "fault_4")
CHANNELS = ("v_z", *RATES)
ACCELERATION_FAULTS = ("fault_vertical", "fault_roll", "fault_pitch", "fault_yaw")
TORQUE_FAULTS = ("fault_roll", "fault_pitch", "fault_yaw")


@dataclass(frozen=True)
class ObserverOptions(Envelope):
    """What every observer is laid out for."""

    attitude_noise: float | None = option(
        None, "rad", "weight of the attitude noise; none: the vehicle's sensor", minimum=POSITIVE
    )
    gyro_noise: float | None = option(
        None, "rad/s", "weight of the gyro noise; none: the vehicle's sensor", minimum=POSITIVE
    )
    velocity_noise: float | None = option(
        None, "m/s", "weight of white noise of v_z; none: from the vehicle's sensors", minimum=POSITIVE
    )
    uncertainty: tuple[float, float, float, float] = option(
        (0.3, 1.0, 1.0, 0.3),
        "m/s2, rad/s2",
        "largest accelerations of v_z, p, q, r that a healthy vehicle has beyond its model and a constant offset",
    )
    noise_multiple: float = option(
        4.5, "1", "largest measurement noise that margins allow for, in standard deviations", minimum=POSITIVE
    )
    state_weight: float = option(0.1, "1", "weight of the state's error in the performance output z", minimum=POSITIVE)
    lipschitz: float | None = option(None, "1/s", "Lipschitz constant; none: computed over the envelope")
    exact_kinematics: bool = option(
        True,
        "",
        "the observer turns body rates into Euler rates with R_eta; false: with the identity, as the papers do",
    )
    step_size: float = option(0.002, "s", "step at which the observer runs", minimum=POSITIVE)
    integrator: str = option("rk4", "", "how it advances over a step: euler, heun, rk4 or exact", choices=INTEGRATORS)


@dataclass(frozen=True)
class FaultObserverOptions(ObserverOptions):
    """What an observer of faults is laid out for besides."""

    speed: float = option(1.0, "1", "faster (above 1) or quieter (below 1): multiplies fault_rate", minimum=POSITIVE)
    fault_rate: float = option(
        0.3, "1/s", "weight of the faults' rate of change: how fast losses are expected to change", minimum=POSITIVE
    )
    fault_weight: float = option(1.0, "1", "weight of the faults' error in the performance output z", minimum=POSITIVE)
    filtered_velocity: bool = option(
        True, "", "v_z is known through the vehicle's velocity filter, and the observer knows that; false: v_z is ideal"
    )


def noise_sizes(vehicle: Vehicle, options: ObserverOptions) -> Array:
    """Sizes (7) of the noise of roll, pitch, yaw, p, q, r, v_z: as asked for, else the vehicle's sensors'.

    v_z is the derivative of captured positions through w0^2 s / (s + w0)^2; white noise of standard deviation sigma,
    held for a period T, leaves it with sigma sqrt(T w0^3 / 4).
    """
    sensors = vehicle.fill(SensorParameters)
    period, bandwidth = sensors.motion_capture_period, sensors.velocity_filter_bandwidth
    through_filter = sensors.motion_capture_position_noise_std * np.sqrt(period * bandwidth**3 / 4)
    asked = (options.attitude_noise, options.gyro_noise, options.velocity_noise)
    own = (sensors.motion_capture_attitude_noise_std, sensors.gyro_noise_std, through_filter)
    return np.repeat([o if a is None else a for a, o in zip(asked, own, strict=True)], (3, 3, 1))


def rotor_faults(vehicle: Vehicle, options: FaultObserverOptions) -> ErrorModel:
    """`vz4`: attitude, body rates and v_z measured, four independent rotor faults.

    If v_z is filtered, the filter is part of the model. It is driven by the captured height with its noise n, which is
    anything but white in the v that comes out: v' = w0^2 (lag + n) - 2 w0 v with lag = height - filtered height, hence
    lag' = v_z - v. The vertical effect of thrust follows the cosine of the tilt, which is measured: one corner for each
    end of its range.
    """
    hover = flight_model(vehicle)
    filter_states = ("filtered_v_z", "filter_lag") if options.filtered_velocity else ()
    states = (*ATTITUDE, *RATES, *filter_states, "v_z", *ROTOR_FAULTS)
    bandwidth = vehicle.fill(SensorParameters).velocity_filter_bandwidth
    v_z = states.index("v_z")
    corners = []
    for cosine in sorted({1.0, float(np.cos(options.tilt))}, reverse=True):
        A = _attitude_and_rates(states, hover.jacobian[1:, 1:])
        A[_rows(states, RATES), -4:] = -hover.signatures[1:]
        A[v_z, v_z], A[v_z, -4:] = hover.jacobian[0, 0], -cosine * hover.signatures[0]
        if filter_states:
            A[v_z - 2, v_z - 2 : v_z] = -2 * bandwidth, bandwidth**2
            A[v_z - 1, v_z], A[v_z - 1, v_z - 2] = 1.0, -1.0
        corners.append(A)
    outputs = (*ATTITUDE, *RATES, *(filter_states[:1] or ("v_z",)))
    model = _with_faults(vehicle, options, states, outputs, corners)
    if not filter_states:
        return model
    noise = np.eye(len(states))[:, [v_z - 2]] * (bandwidth**2 * _height_noise(vehicle, options))
    # V keeps white noise of the same size besides: it hardly costs anything, and without it gain could be unbounded
    return dataclasses.replace(model, E=rounded(np.hstack((model.E, noise))))


def _height_noise(vehicle: Vehicle, options: ObserverOptions) -> float:
    """Size (m) of noise that is new in each sample and as strong at low frequencies as that of held captures."""
    sensors = vehicle.fill(SensorParameters)
    held = max(1.0, sensors.motion_capture_period / options.step_size)
    return float(sensors.motion_capture_position_noise_std * np.sqrt(held))


def torque_scale(vehicle: Vehicle) -> Array:
    """Largest angular acceleration (3), rad/s2, that the total loss of one rotor in hover causes about each axis."""
    return np.abs(flight_model(vehicle).signatures[1:]).max(axis=1)


def matched_gain(vehicle: Vehicle, lyapunov_scale: float) -> Array:
    """B^T P (3, 6) of P = lyapunov_scale I, 1/(kg.m2): from errors of attitude and rates to the torques behind them."""
    inertia = np.asarray(vehicle.fill(VehicleParameters).inertia)
    return rounded_rows(np.hstack((np.zeros((3, 3)), np.diag(lyapunov_scale / inertia))))


def adaptation_gain(vehicle: Vehicle, learning_rate: Any, fault_gain: Any) -> Array:
    """Gamma F (3, 6) of Gamma (3) and F (by rows), in units of the largest torque that a rotor's loss takes."""
    torque = torque_scale(vehicle) * np.asarray(vehicle.fill(VehicleParameters).inertia)
    return (np.asarray(learning_rate) / rounded(torque))[:, None] * np.array(fault_gain, dtype=float).reshape(3, 6)


def torque_faults(vehicle: Vehicle, options: FaultObserverOptions) -> ErrorModel:
    """`tau3`: attitude and body rates measured, three torque faults; to name a rotor is to assume a single fault."""
    states = (*ATTITUDE, *RATES, *TORQUE_FAULTS)
    A = _attitude_and_rates(states, flight_model(vehicle).jacobian[1:, 1:])
    A[_rows(states, RATES), -3:] = np.diag(torque_scale(vehicle))
    return _with_faults(vehicle, options, states, (*ATTITUDE, *RATES), [A])


def rotor_faults_from_attitude(vehicle: Vehicle, options: FaultObserverOptions) -> ErrorModel:
    """`attitude4`, the model of Ren's paper: attitude and body rates measured, four rotor faults. Undetectable."""
    states = (*ATTITUDE, *RATES, *ROTOR_FAULTS)
    hover = flight_model(vehicle)
    A = _attitude_and_rates(states, hover.jacobian[1:, 1:])
    A[_rows(states, RATES), -4:] = -hover.signatures[1:]
    return _with_faults(vehicle, options, states, (*ATTITUDE, *RATES), [A])


def _rows(states: tuple[str, ...], names: tuple[str, ...]) -> slice:
    first = states.index(names[0])
    return slice(first, first + len(names))


def _attitude_and_rates(states: tuple[str, ...], rate_jacobian: Array) -> Array:
    A = np.zeros((len(states), len(states)))
    A[_rows(states, ATTITUDE), _rows(states, RATES)] = np.eye(3)
    A[_rows(states, RATES), _rows(states, RATES)] = rate_jacobian
    return A


def attitude(vehicle: Vehicle, options: ObserverOptions, disturbance: float) -> ErrorModel:
    """Attitude and body rates measured, no fault estimated; w are angular accelerations of the given size, rad/s2."""
    states = (*ATTITUDE, *RATES)
    A = _attitude_and_rates(states, flight_model(vehicle).jacobian[1:, 1:])
    weights = np.full(6, options.state_weight)
    return _error_model(vehicle, options, states, states, [A], np.eye(6)[:, 3:] * disturbance, weights)


def channels(vehicle: Vehicle, options: ObserverOptions, disturbance: Array) -> ErrorModel:
    """v_z and body rates measured, no fault estimated; w are accelerations of the given sizes (4), m/s2 and rad/s2.

    v_z is the filtered one; what acts on it is known, or bounded, after the same filter.
    """
    A, weights = flight_model(vehicle).jacobian, np.full(4, options.state_weight)
    return _channel_model(vehicle, options, CHANNELS, A, np.diag(disturbance), weights)


def acceleration_faults(vehicle: Vehicle, options: FaultObserverOptions) -> ErrorModel:
    """v_z and body rates measured, four faults: accelerations in units of the largest that one rotor's loss causes."""
    hover = flight_model(vehicle)
    A = np.zeros((8, 8))
    A[:4, :4], A[:4, 4:] = hover.jacobian, np.diag(np.abs(hover.signatures).max(axis=1))
    E = np.eye(8)[:, 4:] * (options.fault_rate * options.speed)
    weights = np.repeat([options.state_weight, options.fault_weight], 4)
    return _channel_model(vehicle, options, (*CHANNELS, *ACCELERATION_FAULTS), A, E, weights)


def _channel_model(
    vehicle: Vehicle, options: ObserverOptions, states: tuple[str, ...], A: Array, E: Array, weights: Array
) -> ErrorModel:
    unit = np.eye(len(states))
    constant = rate_lipschitz(vehicle, options) if options.lipschitz is None else options.lipschitz
    return ErrorModel(
        states=states,
        outputs=CHANNELS,
        A=(rounded(A),),
        C=unit[:4],
        D=unit[:, 1:4],
        N=unit[1:4],
        lipschitz=rounded(constant),
        E=rounded(E),
        V=rounded(np.diag(noise_sizes(vehicle, options)[[6, 3, 4, 5]])),
        W=np.diag(weights),
    )


def _with_faults(
    vehicle: Vehicle,
    options: FaultObserverOptions,
    states: tuple[str, ...],
    outputs: tuple[str, ...],
    corners: list[Array],
) -> ErrorModel:
    faults = [name.startswith("fault") for name in states]
    weights = np.where(faults, options.fault_weight, options.state_weight)
    weights[[name.startswith("filter") for name in states]] = 0.0  # not of the vehicle
    E = np.eye(len(states))[:, faults] * (options.fault_rate * options.speed)
    return _error_model(vehicle, options, states, outputs, corners, E, weights)


def _error_model(
    vehicle: Vehicle,
    options: ObserverOptions,
    states: tuple[str, ...],
    outputs: tuple[str, ...],
    corners: list[Array],
    E: Array,
    weights: Array,
) -> ErrorModel:
    unit = np.eye(len(states))
    affected = (*ATTITUDE, *RATES) if options.exact_kinematics else RATES
    constant = attitude_lipschitz if options.exact_kinematics else rate_lipschitz
    return ErrorModel(
        states=states,
        outputs=outputs,
        A=tuple(rounded(A) for A in corners),
        C=unit[[states.index(name) for name in outputs]],
        D=unit[:, [states.index(name) for name in affected]],
        N=unit[[states.index(name) for name in RATES]],
        lipschitz=rounded(constant(vehicle, options) if options.lipschitz is None else options.lipschitz),
        E=rounded(E),
        V=rounded(np.diag(noise_sizes(vehicle, options)[: len(outputs)])),
        W=np.diag(weights),
    )
