"""Where recorded flights are found; they are no part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator.identification import identify
from rotordx.orchestrator.logs import LoggedFlight, read_flight

VARIABLE = "ROTORDX_FLIGHT_DATA"
BESIDE_THE_REPOSITORY = Path(__file__).parents[2].parent / "shared" / "data"

HEALTHY = ("normal_E8_log00", "normal_E8_log01", "normal_E8_log02")
#: log -> apparent loss of rotor 3: 1 - mean healthy command / mean command
CUT = {
    "cut_m3_1.0mm_E8_log00": 0.06,
    "cut_m3_2.0mm_E8_log01": 0.10,
    "cut_m3_2.5mm_E8_log00": 0.18,
    "cut_m3_3.5mm_E8_log00": 0.25,
}


@pytest.fixture(scope="session")
def crazypad() -> Path:
    """Folder of the CrazyPAD flights; without it the tests are skipped."""
    folder = Path(os.environ.get(VARIABLE, BESIDE_THE_REPOSITORY)) / "crazypad"
    missing = [name for name in (*HEALTHY, *CUT) if not (folder / f"{name}.csv").is_file()]
    if missing:
        pytest.skip(f"no flight data: set {VARIABLE} to the folder that holds crazypad/{missing[0]}.csv")
    return folder


@pytest.fixture(scope="session")
def flights(crazypad) -> dict[str, LoggedFlight]:
    """The seven logs, mapped for the nominal vehicle."""
    vehicle = load_vehicle("crazyflie")
    return {name: read_flight(crazypad / f"{name}.csv", None, vehicle) for name in (*HEALTHY, *CUT)}


@pytest.fixture(scope="session")
def craft(flights, tmp_path_factory) -> Path:
    """The craft that flew, identified from its three healthy flights."""
    out = tmp_path_factory.mktemp("crazypad") / "e8.toml"
    identify([part for name in HEALTHY for part in flights[name].parts], load_vehicle("crazyflie"), out)
    return out
