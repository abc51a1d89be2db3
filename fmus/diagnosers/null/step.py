"""No diagnosis at all: always "no fault". The template of a new diagnoser: copy this folder and fill it.

Keep the names `Parameters`, `State`, `Outputs` and `step`; build, command line, benchmarks and contract tests find
the folder by itself. `interface.py` says what goes in and comes out.
"""

from __future__ import annotations

from math import nan

from casadi import SX

from rotordx.fmus.diagnosers.interface import Clock, Command, DiagnosisOutputs, Measured
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters


@ports
class Parameters:
    """Gains and bounds: parameters of the FMU, start values from the design of lab_x if there is one."""

    constant_threshold: Scalar = port("m/s, rad/s", "threshold shown beside the residual", start=1.0, minimum=0)


@ports
class State:
    """What the diagnoser remembers between samples; start values are the initial state."""

    initialised: Scalar = port("1", "0 until the first sample was seen")


@ports
class Outputs(DiagnosisOutputs):
    """The common outputs, then residual and threshold, then the signals of the method."""

    residual: Vector = port("m/s, rad/s", "what is not as expected: v_z, p, q, r", start=(0,) * 4)
    threshold: Vector = port("m/s, rad/s", "a fault is detected when |residual| exceeds it", start=(0,) * 4)


def step(
    measured: Measured, command: Command, state: State, parameters: Parameters, vehicle: VehicleParameters, clock: Clock
) -> tuple[State, Outputs]:
    """Advance by one sample: SX in, SX out, no branches (`casadi.if_else` instead)."""
    outputs = Outputs(
        fault_detected=0,
        faulty_rotor=0,
        loe_estimate=SX.zeros(4),
        detection_time=nan,
        isolation_time=nan,
        residual=SX.zeros(4),
        threshold=parameters.constant_threshold * SX.ones(4),
    )
    return State(initialised=1), outputs
