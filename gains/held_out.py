"""How far residuals go on healthy flights that a design has not seen: the margin that few flights ask for.

An envelope of a few flights is exceeded by the next one, and no fixed factor says by how much. Leaving out each flight
in turn, and identifying vehicle and design from the others, measures it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.shell.ports import start_values, table, unflatten
from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from rotordx.gains.design import Design
from rotordx.gains.flight_identification import identify_vehicle
from rotordx.gains.flights import Flight


def held_out_ratio(identify: Callable[..., Design], flights: Sequence[Flight], base: Vehicle) -> float:
    """Largest |residual| / threshold on any flight, of the design that all the others give.

    Args:
        identify: of the diagnoser, (flights, vehicle) -> design.
        flights: healthy, at least two.
        base: of the vehicle to be identified.
    """
    ratios = []
    for i, flight in enumerate(flights):
        others = [*flights[:i], *flights[i + 1 :]]
        vehicle, _ = identify_vehicle(others, base, base.name)
        ratios.append(peak_ratio(identify(others, vehicle), vehicle, flight))
    return max(ratios)


def peak_ratio(design: Design, vehicle: Vehicle, flight: Flight) -> float:
    """Largest |residual| / threshold of a diagnoser on a flight, after its warm-up."""
    step = import_module(f"rotordx.fmus.diagnosers.{design.diagnoser}.step")
    values = [
        flight.step_size,
        *vars(vehicle.fill(VehicleParameters)).values(),
        *(design.parameters.get(p.name, p.start) for p in table(step.Parameters)),
    ]
    parameters = np.concatenate([np.ravel(np.asarray(value, dtype=float)) for value in values])
    samples = len(flight.time)
    over_flight = _step_function(design.diagnoser).mapaccum(samples)
    _, y = over_flight(
        start_values(step.State), flight.inputs.T, flight.time[None], np.tile(parameters[:, None], samples)
    )
    outputs = unflatten(step.Outputs, np.array(y))
    warm_up_time: Any = design.parameters.get("warm_up_time", 0.0)
    settled = flight.time - flight.time[0] >= warm_up_time
    ratio: NDArray[np.float64] = np.abs(outputs.residual[:, settled]) / outputs.threshold[:, settled]
    return float(ratio.max())


@cache
def _step_function(diagnoser: str) -> Any:
    from rotordx.fmus.diagnosers.codegen import diagnoser_function

    return diagnoser_function(diagnoser)
