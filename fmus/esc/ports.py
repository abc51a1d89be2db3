"""Ports of the speed controllers: motor lag, speed limits, battery sag and every injected rotor fault."""

from rotordx.fmus.shell.ports import Component, Scalar, Vector, port, ports
from rotordx.fmus.vehicles.parameters import VehicleParameters

FAULT_SLOTS = 8


def _slots(value: float) -> tuple[float, ...]:
    return (value,) * FAULT_SLOTS


@ports
class Inputs:
    """What the flight controller asks for."""

    rotor_speed_command: Vector = port("rad/s", "held over the step", (0, 0, 0, 0))


@ports
class Parameters:
    """Fault slots; several slots on one rotor combine as 1 - prod(1 - loss)."""

    fault_rotor: Vector = port("1", "rotor 1..4, 0: slot not in use", _slots(0), minimum=0, maximum=4)
    fault_profile: Vector = port(
        "1", "0 abrupt, 1 incipient, 2 function, 3 intermittent", _slots(0), minimum=0, maximum=3
    )
    fault_onset: Vector = port("s", "first instant of the fault", _slots(0), minimum=0)
    fault_end: Vector = port("s", "the rotor is healthy again from here on", _slots(1e9), minimum=0)
    fault_magnitude: Vector = port("1", "loss of effectiveness (in thrust)", _slots(0), minimum=0, maximum=0.99)
    fault_growth_rate: Vector = port("1/s", "kappa of an incipient fault", _slots(1), minimum=0)
    fault_slope: Vector = port("1/s", "function: ramp added to the magnitude", _slots(0))
    fault_sine_amplitude: Vector = port("1", "function: sine added to the magnitude", _slots(0))
    fault_sine_rate: Vector = port("rad/s", "function: rate of the sine", _slots(0))
    fault_sine_phase: Vector = port("rad", "function: phase of the sine at onset", _slots(0))
    fault_on_time: Vector = port("s", "intermittent: duration of a loss", _slots(1), minimum=0)
    fault_off_time: Vector = port("s", "intermittent: pause between losses", _slots(1), minimum=0)
    battery_sag_rate: Scalar = port("1/s", "relative loss of thrust of all rotors a second", 0.0, minimum=0)


@ports
class Outputs:
    """Actual rotor speeds at the end of the step, and the truth about the injected losses."""

    rotor_speed: Vector = port("rad/s", "at the end of the step", (0, 0, 0, 0))
    loss_of_effectiveness: Vector = port("1", "truth over the step, for scoring only", (0, 0, 0, 0))


COMPONENT = Component(
    "esc",
    "Speed controllers, motors and injected rotor faults",
    Inputs,
    Outputs,
    (VehicleParameters, Parameters),
    initial_outputs_from_inputs=True,
)
