"""The diagnoser FMUs of a simulation over a recorded flight: fed what was logged, recorded like any other flight."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle, load_vehicle
from rotordx.gains.flight_identification import identify_trim
from rotordx.gains.flights import Flight
from rotordx.orchestrator.documents import validated
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.layout import ComponentSettings
from rotordx.orchestrator.logs import LoggedFlight
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System
from rotordx.orchestrator.wiring import EXTERNAL

Array = NDArray[np.float64]

LOG = "log"  #: component name of what was logged, in a recording
POSITION = f"{LOG}.position"
MEAN_LOSS = "mean_loss_of_effectiveness"
SYSTEM = "replay"  #: the diagnosers alone


def replay(
    logged: LoggedFlight,
    vehicle: str,
    diagnosers: Sequence[str],
    known_losses: Mapping[int, float] | None = None,
    components: Mapping[str, ComponentSettings] | None = None,
) -> Recording:
    """Run diagnosers over the airborne parts of a log.

    Every part is a flight of its own: the diagnosers start afresh. One that has found a fault is not started again
    after a landing, its verdict stands until the end of the recording.

    Args:
        logged: see `logs.read_flight`.
        vehicle: name or path, as in a scenario; its designs are the diagnosers' gains.
        diagnosers: ids.
        known_losses: rotor -> loss of effectiveness from the first airborne sample on, to be scored.
        components: settings of diagnosers, as in a scenario; a diagnoser of another tool needs them.

    Returns:
        time counts from the first row of the log, `log.*` is what the diagnosers were fed; NaN between the parts.

    Raises:
        UserError: vehicle or diagnosers cannot be used.
        ComponentError: an FMU failed.
    """
    settings = {name: of_it.model_dump(exclude_none=True) for name, of_it in (components or {}).items()}
    scenarios = [_scenario(logged, part, vehicle, diagnosers, settings) for part in logged.parts]
    with System(scenarios[0]) as system:
        recordings = [
            fly(scenario, system, external=_inputs(part))
            for scenario, part in zip(scenarios, logged.parts, strict=True)
        ]
    first, duration = recordings[0], sum(scenario.duration_s for scenario in scenarios)
    wall_time = sum(recording.measurements["wall_time_s"] for recording in recordings)
    time, signals = _whole_log(recordings, logged)
    units, descriptions = (_described(signals, first, about) for about in ("units", "descriptions"))
    return Recording(
        time=time,
        signals=signals,
        units=units,
        descriptions=descriptions,
        scenario=first.scenario | {"duration_s": round(duration, 9), "replay": _origin(logged, load_vehicle(vehicle))},
        faults=[
            {"rotor": rotor, "onset_s": float(time[0]), "loss_of_effectiveness": loss, "profile": "abrupt"}
            for rotor, loss in (known_losses or {}).items()
        ],
        diagnosers=first.diagnosers,
        measurements=first.measurements | {"wall_time_s": wall_time, "real_time_factor": duration / wall_time},
    )


def _origin(logged: LoggedFlight, vehicle: Vehicle) -> dict[str, Any]:
    """Where a recording came from, and the loss of each rotor that balances the means of thrust and torques in the log.

    That balance is no diagnoser but a check of one, and of the vehicle file: it does not assume a single faulty rotor,
    and a strongly negative loss says that the vehicle is not the one any more that was identified.
    """
    try:
        trim = identify_trim(logged.parts, vehicle)
    except ValueError as error:
        raise UserError(f"{logged.path}: {error}") from error
    return {
        "log": logged.path.name,
        "signal_map": logged.signal_map.name,
        "parts_s": [[float(part.time[0]), float(part.time[-1])] for part in logged.parts],
        "notes": logged.notes,
        MEAN_LOSS: (1 - trim.effectiveness).round(4).tolist(),
    }


def _scenario(
    logged: LoggedFlight, part: Flight, vehicle: str, diagnosers: Sequence[str], components: Mapping[str, Any]
) -> Scenario:
    """What the diagnosers are run as; the name of the log becomes that of the scenario."""
    document = {
        "name": re.sub(r"[^\w.-]|^[.-]", "_", logged.path.stem),
        "description": f"replay of {logged.path.name}",
        "system": SYSTEM,
        "vehicle": vehicle,
        "diagnosers": list(diagnosers),
        "components": {name: components[name] for name in diagnosers if name in components},
        "step_size_s": logged.step_size,
        "duration_s": (len(part.time) - 1) * logged.step_size,
    }
    return validated(Scenario, document, str(logged.path))


def _inputs(part: Flight) -> dict[str, Array]:
    ports = ("rotor_speed_command", "euler", "body_rate", "vertical_velocity")
    return {f"{EXTERNAL}.{port}": getattr(part, port) for port in ports}


def _whole_log(recordings: Sequence[Recording], logged: LoggedFlight) -> tuple[Array, dict[str, Array]]:
    """Time from the first airborne sample to the last, and the signals: NaN between the parts, verdicts held.

    Instants count on the clock of the log, the inputs have its name.
    """
    first, step = logged.parts[0].time[0], logged.step_size
    starts = [round((part.time[0] - first) / step) for part in logged.parts]
    places = [slice(k, k + len(part.time)) for k, part in zip(starts, logged.parts, strict=True)]
    time = step * (round(first / step) + np.arange(places[-1].stop))

    def joined(values: Sequence[Array]) -> Array:
        whole = np.full((len(time), *values[0].shape[1:]), np.nan)
        for place, of_part in zip(places, values, strict=True):
            whole[place] = of_part
        return whole

    signals = {}
    for key, unit in recordings[0].units.items():
        values = [recording.signals[key] for recording in recordings]
        if unit == "s" and key.endswith("_time"):  # the diagnosers count time from the first sample of a part
            values = [v + part.time[0] for v, part in zip(values, logged.parts, strict=True)]
        signals[_renamed(key)] = joined(values)
    if logged.positions is not None:
        signals[POSITION] = joined(logged.positions)
    for diagnoser in recordings[0].diagnosers:
        for place in places:
            if signals[f"{diagnoser}.fault_detected"][place.stop - 1] > 0.5:
                for key in signals:
                    if key.startswith(f"{diagnoser}."):
                        signals[key][place.stop :] = signals[key][place.stop - 1]
    return time, signals


def _described(signals: Mapping[str, Array], recording: Recording, about: str) -> dict[str, str]:
    """Units or descriptions of the signals."""
    texts = {_renamed(key): text for key, text in getattr(recording, about).items()}
    of_position = {"units": "m", "descriptions": "as logged, not seen by the diagnosers"}[about]
    return {key: texts.get(key, of_position) for key in signals}


def _renamed(key: str) -> str:
    return re.sub(rf"^{EXTERNAL}\.", f"{LOG}.", key)
