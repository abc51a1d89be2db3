"""Fault detection estimator with adaptive thresholds (Avram, Zhang, Khalili, eqs. 17-23)."""

from __future__ import annotations

from casadi import fabs, if_else, logic_and, sum2

from rotordx.fmus.diagnosers.fdie.model import Model
from rotordx.fmus.diagnosers.interface import Clock, any_of, capture_time, hold_filter, latch
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports

#: s: on the first sample the rotors' speeds are known to some percent only; a tenth of all they accelerate the vehicle
#: by, for a motor time constant, bounds the error that this leaves behind
START_ERROR_TIME = 0.003


@ports
class DetectionParameters:
    """Design choices of the detection estimator."""

    observer_gain: Vector = port("1/s", "diagonal of L in (17)", start=(5, 8, 8, 5), minimum=1e-3)
    detection_noise_floor: Vector = port(
        "m/s, rad/s", "added to the detection thresholds: 4.5 sigma of the filtered noise", start=(0,) * 4, minimum=0
    )
    warm_up_time: Scalar = port("s", "nothing is detected until so long after the first sample", start=2.0, minimum=0)


@ports
class DetectionState:
    """Residual and its bound, and what was decided."""

    first_time: Scalar = port("s", "time of the first sample")
    residual: Vector = port("m/s, rad/s", "epsilon of (19)", start=(0,) * 4)
    bound: Vector = port("m/s, rad/s", "epsilon_bar of (23), without noise floor", start=(0,) * 4)
    fault_detected: Scalar = port("1", "latched")
    detection_time: Scalar = port("s", "T_d, NaN before", start=float("nan"))


def advance_detection(
    state: DetectionState, started: Scalar, model: Model, parameters: DetectionParameters, clock: Clock
) -> DetectionState:
    """Advance the estimator over one step and decide; `started` is 0 on the first sample.

    On that sample no step has passed: the residual is 0. Its bound starts settled, and with what (22) demands for an
    initial error: that of the rotor speeds, which are taken for commanded.
    """
    decay, gain = hold_filter(parameters.observer_gain, clock.dt)
    residual = if_else(started, decay * state.residual + gain * (model.zeta_rate - model.nominal), 0)  # (19)
    start_bound = model.bound / parameters.observer_gain + START_ERROR_TIME * sum2(fabs(model.signatures))
    bound = if_else(started, decay * state.bound + gain * model.bound, start_bound)  # (23)
    first_time = if_else(started, state.first_time, clock.time)

    exceeds = any_of(fabs(residual) > bound + parameters.detection_noise_floor)
    detected = latch(state.fault_detected, logic_and(is_warm(first_time, parameters, clock), exceeds))
    detection_time = capture_time(state.detection_time, state.fault_detected, detected, clock.time)
    return DetectionState(first_time, residual, bound, detected, detection_time)


def is_warm(first_time: Scalar, parameters: DetectionParameters, clock: Clock) -> Scalar:
    """1 once a fault can be detected: a threshold is in force."""
    return clock.time - first_time > parameters.warm_up_time - clock.dt / 2
