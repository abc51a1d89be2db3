"""Skeletons that carry an exported diagnoser into a firmware: where its signals come from, where its verdict goes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.resources import files

import numpy as np

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export.subject import Subject
from rotordx.orchestrator.export.templates import filled

#: what there is: name of the folder -> what it is
WRAPPERS = {
    "px4": "PX4 module: uORB topics in, a log topic out",
    "crazyflie": "Crazyflie app: log variables in, a log group out",
    "rtos": "FreeRTOS task: a queue of samples in, the latest diagnosis out",
}

#: The motors of a quad X in the autopilot's order, as signs of their positions front and right.
_MOTORS = {
    "px4": ((1, 1), (-1, -1), (1, -1), (-1, 1)),
    "crazyflie": ((1, 1), (-1, 1), (-1, -1), (1, -1)),
}
_SIGNALS = "rotordx_signals.h"
_STACK_RESERVE = 1024  #: bytes for the mathematical library and the kernel


def contents(exported: Subject, chosen: Iterable[str], values: Mapping[str, object]) -> dict[str, str]:
    """Files of wrappers: path -> text.

    Args:
        exported: the diagnoser.
        chosen: names of wrappers.
        values: what fills the gaps that all templates have.

    Raises:
        UserError: a wrapper does not know the order of the vehicle's rotors, or cannot run at its step size.
    """
    written = {}
    for name in chosen:
        own = dict(values) | {"step_us": round(1e6 * exported.step_size), "stack_words": _stack_words(exported)}
        if name in _MOTORS:
            own["rotor_of_motor"] = ", ".join(map(str, rotor_of_motor(exported.vehicle, name)))
            written[f"{name}/{_SIGNALS}"] = filled(f"{_SIGNALS}.in", **own)
        if name == "crazyflie" and round(1e3 * exported.step_size, 9) % 1:
            raise UserError(
                f"the crazyflie wrapper runs on ticks of 1 ms, which {exported.step_size:g} s is no multiple of: "
                "export with another --step-size"
            )
        for template in files("rotordx.orchestrator.export.templates").joinpath(name).iterdir():
            written[f"{name}/{template.name.removesuffix('.in')}"] = filled(f"{name}/{template.name}", **own)
    return dict(sorted(written.items()))


def rotor_of_motor(vehicle: Vehicle, autopilot: str) -> list[int]:
    """Rotor of the vehicle, counted from 0, in the place of each motor of an autopilot's quad X.

    Raises:
        UserError: the vehicle is no quad X.
    """
    body = vehicle.fill(VehicleParameters)
    places = np.sign(np.round(np.column_stack((body.rotor_x, body.rotor_y)), 9)).astype(int).tolist()
    order = [places.index(list(motor)) if list(motor) in places else None for motor in _MOTORS[autopilot]]
    if None in order:
        raise UserError(
            f"the {autopilot} wrapper knows the motors of a quad X, which {vehicle.name} is not: export without it, or "
            "with --wrapper rtos, and put the rotors in order where the samples are made"
        )
    return [rotor for rotor in order if rotor is not None]


def _stack_words(exported: Subject) -> int:
    """Stack of a task in words of 4 bytes: twice the state covers what the compiler keeps of a step, and a reserve."""
    state = 4 * exported.state_numbers
    return (2 * state + _STACK_RESERVE + 1500) // 4
