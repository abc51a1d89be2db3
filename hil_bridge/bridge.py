"""Flies a scenario whose rotors are on a bus: commands go out, and the flight goes on with what comes back."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from rotordx.hil_bridge.own_emulator import own_emulator
from rotordx.hil_bridge.pacing import undisturbed
from rotordx.hil_bridge.settings import MEASURED, OWN, BridgeSettings
from rotordx.hil_bridge.ticker import FED, SPEED, Ticker, ticking
from rotordx.hil_bridge.timing import figures
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System

TRUE_SPEED = "esc.rotor_speed"

PRESENCE_TIMEOUT = 15.0  #: s in which all ESCs have to be heard of
NO_LAG = 1e-6  #: s, time constant of motors whose speed is measured


@dataclass(frozen=True)
class BridgedFlight:
    """A flight over a bus; `verdict` is None if it came to its end."""

    recording: Recording
    figures: dict[str, Any]  #: plain data, see `timing.figures`
    verdict: str | None


def fly_over_bus(
    scenario: Scenario, settings: BridgeSettings, progress: Callable[[float], None] | None = None
) -> BridgedFlight:
    """Fly a scenario with its rotors on a bus.

    The esc FMU of the flight goes on as a model of what the ESCs should do: it tells which losses act, for the scores
    and, with real ESCs, for what the commands are reduced by; the plant gets what came over the bus.

    Args:
        scenario: the flight.
        settings: the bus.
        progress: called now and then with the time flown (s).

    Raises:
        UserError: the scenario is impossible over this bus.
        BusError: there is no such bus, no ESC answers, or the bus was lost before the flight began.
        ComponentError: an FMU failed.
    """
    settings.plan(scenario).check()
    with ExitStack() as stack:
        ticker = stack.enter_context(ticking(scenario, settings))
        if settings.escs == OWN:
            stack.enter_context(own_emulator(settings.bus.perfect, scenario, settings.setup, fifo=settings.fifo))
        flown = bridged_scenario(scenario, settings.fed_speed)
        system = stack.enter_context(System(flown))
        system.initialise(flown)
        hover = system.signal(TRUE_SPEED).copy()
        ticker.escs.wait_until_present(PRESENCE_TIMEOUT)
        granted = stack.enter_context(undisturbed(fifo=settings.fifo))
        stack.callback(ticker.escs.stop)
        recording = fly(
            flown,
            system,
            initial=dict.fromkeys((info.key for info in system.wiring.external), hover),
            callback=ticker,
            progress=_rarely(progress),
        )
    report = figures(recording, scenario, settings, ticker, granted)
    return BridgedFlight(_described(recording, ticker), report, ticker.verdict)


def bridged_scenario(scenario: Scenario, fed_speed: str) -> Scenario:
    """The scenario in which plant and diagnosers take rotor speeds from outside."""
    own = {connection["to"] for connection in (c.model_dump(by_alias=True) for c in scenario.connections)}
    targets = {"plant.rotor_speed": SPEED, **{f"{name}.rotor_speed_command": FED for name in scenario.diagnosers}}
    connections = [{"from": source, "to": target} for target, source in targets.items() if target not in own]
    components = {name: settings.model_dump(exclude_none=True) for name, settings in scenario.components.items()}
    if fed_speed == MEASURED:
        for name in scenario.diagnosers:
            settings = components.setdefault(name, {})
            settings["parameters"] = {"motor_time_constant": NO_LAG} | settings.get("parameters", {})
    return scenario.changed(
        connections=[*(c.model_dump(by_alias=True) for c in scenario.connections), *connections], components=components
    )


def _described(recording: Recording, ticker: Ticker) -> Recording:
    """The recording with the telemetry; rotor speeds as they came over the bus take the place of the model's."""
    rows = len(recording.time)
    telemetry = {
        "bus.rpm": (ticker.rpm, "1/min", "rotor speed of each ESC's last Status"),
        "bus.status_age": (ticker.status_age, "s", "time since that Status came"),
        "bus.answer_age": (ticker.answer_age, "s", "time since the command was sent that the rotor speeds answer"),
        "bus.lateness": (ticker.lateness, "s", "how late the step was begun, in real time"),
        "bus.degraded": (ticker.degraded, "1", "1: too few of the last second's answers were fresh"),
    }
    signals, units, descriptions = dict(recording.signals), dict(recording.units), dict(recording.descriptions)
    for key, (values, unit, description) in telemetry.items():
        signals[key], units[key], descriptions[key] = values[:rows], unit, description
    for old, new in ((TRUE_SPEED, "esc_model.rotor_speed"), (SPEED, TRUE_SPEED), (FED, "bus.rotor_speed_command")):
        if old in signals:
            signals[new], units[new] = signals.pop(old), units.pop(old)
            descriptions[new] = descriptions.pop(old)
    descriptions[TRUE_SPEED] = "as it came over the bus"
    return replace(recording, signals=signals, units=units, descriptions=descriptions)


def _rarely(progress: Callable[[float], None] | None) -> Callable[[float], None] | None:
    """Progress twice a second of machine time, for showing it takes a good part of a tick."""
    if progress is None:
        return None
    shown = 0.0

    def show(now: float) -> None:
        nonlocal shown
        if time.monotonic() - shown > 0.5:
            shown = time.monotonic()
            progress(now)

    return show
