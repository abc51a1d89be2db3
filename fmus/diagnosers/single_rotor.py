"""From estimated accelerations to a verdict: calibration on the healthy vehicle, and the one rotor that explains them.

An observer of faults estimates what accelerates the vehicle beyond its healthy model, in the channels v_z, p, q, r
(m/s2, rad/s2; a method that does not estimate v_z puts 0 there, in its signatures too). Three steps follow:

- A constant disturbance is indistinguishable from a fault. The mean over a healthy window is taken as this vehicle's
  offset, and what is decided on is the deviation from it. Nothing can be detected before.
- A fault is detected by the method's own rule; without one, by a deviation beyond its margin.
- Rotor s stays possible while some loss theta in [0, 1] leaves |deviation - theta h_s| within the margin (and a share
  of the deviation, for what h_s is wrong by) in every channel that has settled; h_s is the fault signature of the model
  terms. As long as the margins hold for the healthy vehicle, and one rotor has lost effectiveness, that rotor stays
  possible: no other one is named. The rotor that alone is possible is named; if none is, the fault is no loss of a
  single rotor.
"""

from __future__ import annotations

from math import nan

from casadi import fabs, fmax, fmin, if_else, logic_and, mmax, mmin, repmat, sum1, vertcat

from rotordx.fmus.diagnosers.interface import ROTORS, Clock, DiagnosisOutputs, any_of, capture_time, latch
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports

#: m/s2, rad/s2: a signature below it says nothing about a loss, a margin below it is one of a noiseless simulation
NEGLIGIBLE = 1e-9

#: margin of a channel that does not count, m/s2 or rad/s2
UNBOUNDED = 1e9


@ports
class CalibrationParameters:
    """When the vehicle is taken for healthy."""

    warm_up_time: Scalar = port("s", "nothing is calibrated or decided until so long after the start", 2.0, minimum=0)
    calibration_time: Scalar = port(
        "s", "the mean estimate over so long after the warm-up is the healthy offset; 0: no offset", 3.0, minimum=0
    )


@ports
class DecisionParameters(CalibrationParameters):
    """What a healthy vehicle stays within, and how long a finding must last."""

    margin: Vector = port(
        "m/s2, rad/s2", "largest deviation of v_z, p, q, r on a healthy vehicle (gains/margins.py)", (1,) * 4, minimum=0
    )
    signature_error: Scalar = port(
        "1", "relative error of the signatures: inertias, thrusts, what settles", 0.1, minimum=0
    )
    settling_time: Vector = port(
        "s", "v_z, p, q, r count for isolation so long after detection", (0.3, 0.05, 0.05, 0.05), minimum=0
    )
    dwell_time: Scalar = port("s", "a rotor is named that alone has been possible for so long", 0.02, minimum=0)
    doubt_time: Scalar = port("s", "no single rotor (-1) if none has been possible for so long", 0.5, minimum=0)


@ports
class CalibrationState:
    """Mean estimate over the healthy window."""

    first_time: Scalar = port("s", "time of the first sample")
    offset: Vector = port("m/s2, rad/s2", "mean estimate of v_z, p, q, r", start=(0,) * 4)
    offset_samples: Scalar = port("1", "number of samples in it")


@ports
class VerdictState:
    """What was decided, and what is about to be."""

    fault_detected: Scalar = port("1", "latched")
    detection_time: Scalar = port("s", "NaN before", start=nan)
    candidate: Scalar = port("1", "rotor that alone is possible, -1 if none is, 0 if several are")
    candidate_since: Scalar = port("s", "since when, NaN before detection", start=nan)
    faulty_rotor: Scalar = port("1", "1..4, -1 no loss of a single rotor, 0 not yet (latched)")
    isolation_time: Scalar = port("s", "time at which a rotor was named, NaN before", start=nan)


@ports
class DecisionState(VerdictState, CalibrationState):
    """Calibration, verdict (dataclass fields of the last base lead)."""


def calibrated(
    estimate: Vector, started: Scalar, state: CalibrationState, parameters: CalibrationParameters, clock: Clock
) -> tuple[CalibrationState, Vector, Scalar]:
    """Take the healthy offset from an estimate (4).

    Args:
        estimate: unknown accelerations of v_z, p, q, r, m/s2 and rad/s2.
        started: 0 on the first sample.

    Returns:
        state, deviation from the offset (4), and 1 once a fault can be detected.
    """
    first_time = if_else(started, state.first_time, clock.time)
    age = clock.time - first_time + clock.dt / 2
    armed = age > parameters.warm_up_time + parameters.calibration_time
    samples = state.offset_samples + logic_and(age > parameters.warm_up_time, 1 - armed)
    moving = samples > state.offset_samples
    offset = if_else(moving, state.offset + (estimate - state.offset) / fmax(samples, 1), state.offset)
    return CalibrationState(first_time, offset, samples), estimate - offset, armed


def exceeds_margin(deviation: Vector, parameters: DecisionParameters) -> Scalar:
    """1 if a deviation (4) is larger than any healthy one."""
    return any_of(fabs(deviation) > parameters.margin)


def decide(
    exceeds: Scalar,
    deviation: Vector,
    armed: Scalar,
    signatures: Vector,
    state: VerdictState,
    parameters: DecisionParameters,
    clock: Clock,
) -> tuple[VerdictState, DiagnosisOutputs]:
    """Detect and isolate.

    Args:
        exceeds: 1 if the method's own rule says that there is a fault.
        deviation: of v_z, p, q, r from their healthy offsets (4), m/s2 and rad/s2.
        armed: 1 once a fault can be detected.
        signatures: columns h_s, what the total loss of each rotor adds to the channels (4, 4), m/s2 and rad/s2.

    Returns:
        state and the outputs common to all diagnosers; the loss is the least-squares one over the settled channels.
    """
    detected = latch(state.fault_detected, logic_and(armed, exceeds))
    detection_time = capture_time(state.detection_time, state.fault_detected, detected, clock.time)

    settled = logic_and(detected, clock.time - detection_time > parameters.settling_time - clock.dt / 2)
    margin = fmax(parameters.margin, NEGLIGIBLE) + parameters.signature_error * fabs(deviation)
    margin = if_else(settled, margin, UNBOUNDED)
    possible = _possible(deviation, margin, signatures)
    count = sum1(possible)
    candidate = if_else(detected, if_else(count == 1, possible.T @ ROTORS, -(count == 0)), 0)
    candidate_since = if_else(candidate == state.candidate, state.candidate_since, clock.time)
    needed = if_else(candidate > 0, parameters.dwell_time, parameters.doubt_time)
    lasting = logic_and(candidate != 0, clock.time - candidate_since > needed - clock.dt / 2)
    rotor = if_else(state.faulty_rotor == 0, if_else(lasting, candidate, 0), state.faulty_rotor)
    isolation_time = capture_time(state.isolation_time, state.faulty_rotor > 0, rotor > 0, clock.time)

    loss = fmax(0, fmin(1, _least_squares_loss(deviation, margin, signatures)))
    verdict = DiagnosisOutputs(
        fault_detected=detected,
        faulty_rotor=rotor,
        loe_estimate=if_else(rotor == ROTORS, loss, 0),
        detection_time=detection_time,
        isolation_time=isolation_time,
    )
    return VerdictState(detected, detection_time, candidate, candidate_since, rotor, isolation_time), verdict


def _possible(deviation: Vector, margin: Vector, signatures: Vector) -> Vector:
    """1 for each rotor whose loss alone can explain the deviation within the margins (4)."""
    divisor = if_else(fabs(signatures) < NEGLIGIBLE, NEGLIGIBLE, signatures)
    one = repmat(deviation - margin, 1, 4) / divisor
    other = repmat(deviation + margin, 1, 4) / divisor
    lower, upper = fmin(one, other), fmax(one, other)
    return vertcat(*(fmax(0, mmax(lower[:, s])) <= fmin(1, mmin(upper[:, s])) for s in range(4)))


def _least_squares_loss(deviation: Vector, margin: Vector, signatures: Vector) -> Vector:
    """Loss (4) of each rotor that alone explains the deviation best, channels weighted by their margins."""
    scaled = signatures / repmat(margin, 1, 4)
    return (scaled.T @ (deviation / margin)) / fmax(sum1(scaled**2).T, NEGLIGIBLE**2)
