"""Healthy simulated flights of one specimen of a vehicle, and what diagnosers are identified from them.

`python -m rotordx.orchestrator.healthy_flights` writes the packaged designs anew (`make designs`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rotordx.fmus.vehicles import Vehicle, load_vehicle
from rotordx.gains.design import Design, write_design
from rotordx.gains.fdie import identify
from rotordx.gains.flights import Flight
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System

#: Angular rate (rad/s) and yaw amplitude (rad) of the circles: below, at and above those of the benchmark.
CIRCLES = ((0.6, 0.3), (0.8, 0.5), (1.0, 0.7))
SEED = 100
PACKAGED_VEHICLES = ("lab_x", "crazyflie", "f450_plus", "ren_plus")


def flight_of(recording: Recording, name: str) -> Flight:
    """What the diagnosers of a simulated flight were fed, from its first step on."""
    fed = {
        "rotor_speed_command": "controller.rotor_speed_command",
        "euler": "sensors.euler",
        "body_rate": "sensors.body_rate",
        "vertical_velocity": "sensors.vertical_velocity",
    }
    return Flight(name, recording.time[1:], **{port: recording.signals[key][1:] for port, key in fed.items()})


def healthy_flights(
    vehicle: str = "lab_x", seed: int = SEED, actual_vehicle: Vehicle | None = None
) -> Iterator[tuple[Flight, Mapping[str, Any]]]:
    """Circles of 60 s in gusts, each with what it was.

    Args:
        vehicle: as controller and diagnosers believe it to be.
        seed: of the first circle; the next ones follow.
        actual_vehicle: the specimen that is flown, None: the vehicle itself.
    """
    scenario = load_scenario("healthy_circle", vehicle=vehicle, diagnosers=[])
    with System(scenario) as system:
        for i, (angular_rate, yaw_amplitude) in enumerate(CIRCLES):
            motion = {
                "angular_rate": angular_rate,
                "yaw_amplitude": yaw_amplitude,
                "initial_velocity": [0.0, angular_rate, 0.0],  # radius 1 m
            }
            circle = scenario.changed(seed=seed + i, parameters=scenario.parameters | motion)
            recording = fly(circle, system, actual_vehicle=actual_vehicle)
            yield (
                flight_of(recording, f"circle at {angular_rate} rad/s"),
                {"scenario": scenario.name, "seed": circle.seed, **motion},
            )


def identify_in_simulation(vehicle: str, seed: int = SEED, actual_vehicle: Vehicle | None = None) -> Design:
    """Design of `fdie` from healthy simulated flights; arguments as of `healthy_flights`."""
    flights, provenance = zip(*healthy_flights(vehicle, seed, actual_vehicle), strict=True)
    return identify(flights, load_vehicle(vehicle), provenance=provenance)


def main() -> None:
    """Write the packaged designs into the folder of the packaged vehicles."""
    for name in PACKAGED_VEHICLES:
        folder = Path(load_vehicle(name).files[0]).parent / "designs"
        print(write_design(identify_in_simulation(name), folder))


if __name__ == "__main__":
    main()
