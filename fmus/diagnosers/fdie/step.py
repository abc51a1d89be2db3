"""Fault detection, isolation and estimation by adaptive thresholds.

R. C. Avram, X. Zhang, M. Khalili, "Quadrotor Actuator Fault Diagnosis with Real-Time Experimental Results": known model
(15), (25), (33) in `model.py`, detection (17)-(23) in `detection.py`, isolation and estimation (26), (27), (31) in
`isolation.py`, their extension to sets of losses in `set_membership.py`, the decision in `naming.py`. The README has
every deviation from the paper.
"""

from __future__ import annotations

from math import nan

from casadi import horzcat, if_else, repmat, sum1

from rotordx.fmus.diagnosers.fdie.detection import DetectionParameters, DetectionState, advance_detection, is_warm
from rotordx.fmus.diagnosers.fdie.isolation import (
    IsolationParameters,
    IsolationState,
    advance_isolation,
    initial_isolation,
)
from rotordx.fmus.diagnosers.fdie.model import ModelParameters, ModelState, known_model
from rotordx.fmus.diagnosers.fdie.naming import NamingParameters, NamingState, advance_naming
from rotordx.fmus.diagnosers.fdie.set_membership import (
    SetParameters,
    SetState,
    advance_set,
    estimated_loss,
    initial_set,
)
from rotordx.fmus.diagnosers.interface import ROTORS, Clock, Command, DiagnosisOutputs, Measured, select
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class Parameters(ModelParameters, NamingParameters, SetParameters, IsolationParameters, DetectionParameters):
    """Detection, isolation, sets, naming, model (dataclass fields of the last base lead)."""


@ports
class State(NamingState, SetState, IsolationState, DetectionState, ModelState):
    """Model, detection, isolation, sets, names."""

    started: Scalar = port("1", "0 until the first sample")


@ports
class Outputs(DiagnosisOutputs):
    """Channels are v_z, p, q, r; element 4 s + j belongs to estimator s, channel j, both counted from 0."""

    residual: Vector = port("m/s, rad/s", "epsilon of (19): v_z, p, q, r", start=(0,) * 4)
    threshold: Vector = port("m/s, rad/s", "epsilon_bar of (23) and noise floor, NaN until warm", start=(nan,) * 4)
    isolation_residual: Vector = port("m/s, rad/s", "zeta - zeta_hat_s of (28)", start=(0,) * 16)
    isolation_threshold: Vector = port("m/s, rad/s", "mu_s of (31) and noise floor", start=(0,) * 16)
    excluded: Vector = port("1", "rotors excluded by the paper's rule (latched)", start=(0,) * 4)
    paper_rotor: Scalar = port("1", "as faulty_rotor, by the paper's rule")
    paper_isolation_time: Scalar = port("s", "as isolation_time, by the paper's rule", start=nan)
    set_lower: Vector = port("1", "smallest loss of each rotor that the measurements allow", start=(0,) * 4)
    set_upper: Vector = port("1", "largest loss of each rotor that the measurements allow", start=(0,) * 4)
    set_excluded: Vector = port("1", "rotors excluded by set membership (latched)", start=(0,) * 4)
    set_rotor: Scalar = port("1", "as faulty_rotor, by set membership")
    set_isolation_time: Scalar = port("s", "as isolation_time, by set membership", start=nan)
    fie_loe_estimate: Vector = port("1", "theta_hat_s of (27) of each estimator, 0 before detection", start=(0,) * 4)
    loe_lower: Scalar = port("1", "smallest loss allowed of the named rotor, 0 before, NaN if none is left")
    loe_upper: Scalar = port("1", "largest loss allowed of the named rotor, 0 before, NaN if none is left")


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: all estimators over the step that ends now, then the decisions at its end."""
    isolating = state.fault_detected
    known, model = known_model(measured, command, state.started, isolating, state, parameters, vehicle, clock)
    detection = advance_detection(state, state.started, model, parameters, clock)

    floor = parameters.detection_noise_floor
    isolation = select(isolating, advance_isolation(state, model, parameters, clock.dt), initial_isolation(parameters))
    sets = select(
        isolating,
        advance_set(state, model, parameters.observer_gain, floor, parameters, clock.dt),
        initial_set(floor, parameters.loe_max),
    )
    naming = advance_naming(
        state,
        horzcat(state.excluded, state.set_excluded),
        horzcat(isolation.excluded, sets.set_excluded),
        parameters,
        clock,
    )

    by_sets = parameters.isolation_rule == 1
    rotor = if_else(by_sets, naming.named[1], naming.named[0])
    loe = if_else(by_sets, estimated_loss(sets), isolation.fie_loe)
    is_named = rotor == ROTORS
    outputs = Outputs(
        fault_detected=detection.fault_detected,
        faulty_rotor=rotor,
        loe_estimate=if_else(is_named, loe, 0),
        detection_time=detection.detection_time,
        isolation_time=if_else(by_sets, naming.naming_time[1], naming.naming_time[0]),
        residual=detection.residual,
        threshold=if_else(is_warm(detection.first_time, parameters, clock), detection.bound + floor, nan),
        isolation_residual=isolation.isolation_residual,
        isolation_threshold=isolation.isolation_bound + repmat(parameters.isolation_noise_floor, 4, 1),
        excluded=isolation.excluded,
        paper_rotor=naming.named[0],
        paper_isolation_time=naming.naming_time[0],
        set_lower=sets.set_lower,
        set_upper=sets.set_upper,
        set_excluded=sets.set_excluded,
        set_rotor=naming.named[1],
        set_isolation_time=naming.naming_time[1],
        fie_loe_estimate=if_else(detection.fault_detected, isolation.fie_loe, 0),
        loe_lower=sum1(if_else(is_named, if_else(sets.set_excluded, nan, sets.set_lower), 0)),
        loe_upper=sum1(if_else(is_named, if_else(sets.set_excluded, nan, sets.set_upper), 0)),
    )
    return State(**vars(known), **vars(detection), **vars(isolation), **vars(sets), **vars(naming), started=1), outputs
