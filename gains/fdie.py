"""Uncertainty bound and noise floors of `fdie`, identified offline on healthy flights.

Avram, Zhang, Khalili, section 4.1, but not (34) as printed: |d zeta/dt - f| of the running flight contains the fault,
so a bound made of it absorbs the fault and nothing is ever detected. Here, on flights known to be healthy:

- the offset xi_0 is the constant of d zeta/dt - f in each channel, by least squares;
- the bound xi_bar = c_0 + c_1 |u| + c_2 |u_unlagged - u| is the lowest envelope (a linear program) of what remains,
  smoothed because noise has a floor of its own, times the epsilon = 1.25 of (34). The slopes are capped: a bound that
  grows with |u| grows with the controller's answer to a fault, too;
- the noise floors are 4.5 standard deviations of the sensors' noise behind the estimators' filters, computed exactly.

No scale of the input is identified: in closed loop the controller correlates input and disturbance, which biases it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from casadi import SX, Function, vertcat
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import linprog

from rotordx.fmus.diagnosers.fdie.detection import DetectionState, advance_detection
from rotordx.fmus.diagnosers.fdie.model import ModelState, known_model
from rotordx.fmus.diagnosers.fdie.step import Parameters
from rotordx.fmus.diagnosers.interface import Clock, Inputs, critically_damped_filter, hold_filter
from rotordx.fmus.model_terms.symbols import symbols
from rotordx.fmus.shell.ports import flatten, port, ports, start_values, table
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.fmus.vehicles.vehicle import Vehicle
from rotordx.gains.design import Design, vehicle_hash
from rotordx.gains.flights import Flight

Array = NDArray[np.float64]

#: epsilon of (34)
BOUND_FACTOR = 1.25
#: smallest c_0, m/s2 or rad/s2: no threshold vanishes
SMALLEST_CONSTANT = 0.02
#: largest c_1 and c_2
LARGEST_SLOPES = (0.06, 0.3)
#: s, length of the moving mean that smooths the residual
SMOOTHING_TIME = 0.09
#: s, between the samples that go into the linear program
SAMPLING_TIME = 0.01
#: standard deviations of the filtered noise that a floor covers
NOISE_FACTOR = 4.5
#: what a design writes down, free of a solver's last bits
SIGNIFICANT_DIGITS = 4

#: the three terms of the bound
_BOUND_TERMS = ("bound_constant", "bound_slope", "bound_transient_slope")


@ports
class _DetectionState(DetectionState, ModelState):
    """What the detection estimator needs of the diagnoser's state."""

    started: Any = port("1", "0 until the first sample")


def identify(
    flights: Sequence[Flight],
    vehicle: Vehicle,
    gains: Mapping[str, float | Sequence[float]] | None = None,
    provenance: Sequence[Mapping[str, Any]] | None = None,
    bound_factor: float = BOUND_FACTOR,
) -> Design:
    """All parameters of `fdie` for a vehicle, from healthy flights of a specimen of it.

    Args:
        flights: of one step size, each longer than the warm-up time; the more kinds of motion, the further the bound
            holds.
        vehicle: as the diagnoser believes it to be; its sensor figures give the noise floors.
        gains: parameters that replace start values of `fdie`, such as `observer_gain`.
        provenance: plain data about each flight (scenario, seed, ...) to be kept in the design.
        bound_factor: of the bound over the envelope; few flights need more, see `held_out.py`.

    Raises:
        ValueError: there is no flight, one is too short or of another step size, or a gain is not a parameter.
    """
    parameters = _chosen(vehicle, gains or {})
    _check(flights, parameters.warm_up_time)
    step_size = round(flights[0].step_size, 9)
    estimator = _estimator(vehicle, parameters, step_size)
    responses = [_responses(flight, estimator, parameters.warm_up_time) for flight in flights]

    settled_offset = np.concatenate([residual for residual, _ in responses]).mean(axis=0)  # of xi_0 / l
    terms = np.concatenate([bounds for _, bounds in responses]).swapaxes(0, 1)  # channel, sample, term
    window = max(1, round(SMOOTHING_TIME / SAMPLING_TIME))
    smooth = [uniform_filter1d(residual - settled_offset, window, axis=0) for residual, _ in responses]
    bound = bound_factor * np.array([_envelope(y, t) for y, t in zip(np.concatenate(smooth).T, terms, strict=True)])

    identified = {
        "offset": settled_offset * parameters.observer_gain,
        **dict(zip(_BOUND_TERMS, bound.T, strict=True)),
        "detection_noise_floor": noise_floor(parameters.observer_gain, vehicle, step_size),
        "isolation_noise_floor": noise_floor(parameters.isolation_gain, vehicle, step_size),
    }
    rounded = {name: [float(f"{v:.{SIGNIFICANT_DIGITS - 1}e}") for v in values] for name, values in identified.items()}
    plain = {p.name: np.asarray(getattr(parameters, p.name)).tolist() for p in table(Parameters) if not p.choices}
    sources = provenance or [{"flight": flight.name} for flight in flights]
    return Design(
        diagnoser="fdie",
        vehicle=vehicle.name,
        parameters=plain | rounded,
        identified_from={
            "flights": [
                {**source, "duration_s": round(float(flight.time[-1] - flight.time[0]), 6)}
                for source, flight in zip(sources, flights, strict=True)
            ],
            "step_size_s": step_size,
            "bound_factor": bound_factor,
            "vehicle_sha256": vehicle_hash(vehicle),
        },
    )


def noise_floor(estimator_gain: Array, vehicle: Vehicle, step_size: float) -> Array:
    """4.5 standard deviations (4,) of the sensors' noise in the residuals of an estimator with gains l (4,), 1/s.

    The root of the summed squares of the impulse response from one sensor sample to the residual: a gyro sample enters
    once; a captured position is held until the next capture, differentiated by (33), and counted at the phase of the
    capture period where it does most. The noise of the Euler angles in cos(roll) cos(pitch) is two orders smaller.
    """
    sensors = vehicle.fill(SensorParameters)
    steps = round(40 / (float(np.min(estimator_gain)) * step_size))  # the response has fallen to exp(-40)
    gyro_sample = np.eye(1, steps)[0]
    hold = max(1, round(sensors.motion_capture_period / step_size))
    capture = _velocity_response(hold, sensors.velocity_filter_bandwidth, steps, step_size)
    drag = vehicle.fill(VehicleParameters).drag_coefficient / vehicle.fill(VehicleParameters).mass

    position_std, gyro_std = sensors.motion_capture_position_noise_std, sensors.gyro_noise_std
    vertical = _residual_response(capture, estimator_gain[0], step_size, drag)
    floors = [position_std * max(np.linalg.norm(vertical[phase::hold]) for phase in range(hold))]
    for gain in estimator_gain[1:]:
        floors.append(gyro_std * np.linalg.norm(_residual_response(gyro_sample, gain, step_size)))
    return NOISE_FACTOR * np.array(floors)


def _velocity_response(hold: int, bandwidth: float, steps: int, step_size: float) -> Array:
    """Output (steps,) of the velocity filter (33) to a position that is 1 for `hold` steps."""
    response, position, velocity = np.empty(steps), 0.0, 0.0
    for k in range(steps):
        position, velocity = critically_damped_filter(position, velocity, float(k < hold), bandwidth, step_size)
        response[k] = velocity
    return response


def _residual_response(measured: Array, gain: float, step_size: float, drag: float = 0.0) -> Array:
    """Residual (steps,) of (19) to an error of the measured channel (steps,), which also enters f by the drag."""
    decay, input_gain = hold_filter(gain, step_size)
    response, residual, before = np.empty(len(measured)), 0.0, 0.0
    for k, value in enumerate(measured):
        residual = decay * residual + input_gain * ((value - before) / step_size + drag * (value + before) / 2)
        response[k], before = residual, value
    return response


def _chosen(vehicle: Vehicle, gains: Mapping[str, float | Sequence[float]]) -> Parameters:
    """Start values of the diagnoser's parameters, the sensors' filter, and what the caller replaces."""
    known = {p.name: p for p in table(Parameters)}
    if unknown := set(gains) - set(known):
        raise ValueError(f"fdie has no parameter {', '.join(sorted(unknown))}; it has {', '.join(known)}")
    sensors = vehicle.fill(SensorParameters)
    values: dict[str, Any] = {name: p.start if p.shape else p.start[0] for name, p in known.items()}
    values |= {"velocity_filter_bandwidth": sensors.velocity_filter_bandwidth, **gains}
    return Parameters(**{name: np.array(v, float) if known[name].shape else float(v) for name, v in values.items()})


def _check(flights: Sequence[Flight], warm_up_time: float) -> None:
    """Flights that can be identified from together."""
    if not flights:
        raise ValueError("fdie is identified from healthy flights, but there is none; give at least one")
    for flight in flights:
        if flight.time[-1] - flight.time[0] <= warm_up_time + SMOOTHING_TIME:
            raise ValueError(f"{flight.name} is not longer than the warm-up time of {warm_up_time:g} s; fly longer")
        if abs(flight.step_size - flights[0].step_size) > 1e-9:
            raise ValueError(f"{flight.name} has another step size than {flights[0].name}; resample it")


def _estimator(vehicle: Vehicle, parameters: Parameters, step_size: float) -> Function:
    """CasADi function (x, inputs, time, c) -> (x_next, [residual; bound]) of the detection estimator alone.

    c: the three terms of the bound, the same in all channels.
    """
    x, state = symbols(_DetectionState)
    u, inputs = symbols(Inputs)
    time, c = SX.sym("time"), SX.sym("c", len(_BOUND_TERMS))
    terms = {name: c[i] * SX.ones(4) for i, name in enumerate(_BOUND_TERMS)}
    parameters = dataclasses.replace(parameters, **terms)
    clock, numbers = Clock(time, step_size), vehicle.fill(VehicleParameters)
    known, model = known_model(inputs, inputs, state.started, SX(0), state, parameters, numbers, clock)
    detection = advance_detection(state, state.started, model, parameters, clock)
    x_next = flatten(_DetectionState(**vars(known), **vars(detection), started=1), vertcat)
    return Function("estimator", [x, u, time, c], [x_next, vertcat(detection.residual, detection.bound)], {"cse": True})


def _responses(flight: Flight, estimator: Function, warm_up_time: float) -> tuple[Array, Array]:
    """Residual (n, 4) and bounds (n, 4, 3) of a flight behind the estimator's filter, sampled after the warm-up.

    The third axis of the bounds has one of them for each term of xi_bar, with the coefficient 1.
    """
    over_flight = estimator.mapaccum(len(flight.time))
    start = np.array(start_values(_DetectionState))
    skip, stride = round(warm_up_time / flight.step_size), max(1, round(SAMPLING_TIME / flight.step_size))
    bounds = []
    for term in np.eye(len(_BOUND_TERMS)):
        _, y = over_flight(start, flight.inputs.T, flight.time[None], np.tile(term[:, None], len(flight.time)))
        residual, bound = np.split(np.array(y).T[skip::stride], 2, axis=1)
        bounds.append(bound)
    return residual, np.stack(bounds, axis=-1)


def _envelope(residual: Array, terms: Array) -> Array:
    """Coefficients c (3,) of the lowest bound terms @ c >= |residual|: least mean, slopes within their caps."""
    limits = [(SMALLEST_CONSTANT, None), *((0.0, largest) for largest in LARGEST_SLOPES)]
    solution = linprog(terms.mean(axis=0), A_ub=-terms, b_ub=-np.abs(residual), bounds=limits, method="highs")
    return np.asarray(solution.x)
