"""Whatever a recording holds or lacks, there is a report of it, complete in itself and of a bearable size."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rotordx.orchestrator import metrics, report
from tests.report.synthetic import circle_flight
from tests.results.hand_made import FAULT, recording

N = 101
TIME = np.arange(N) * 0.1
NAN = np.full((N, 4), np.nan)

ODD: dict[str, dict[str, Any]] = {
    "all NaN": {"residual": NAN, "threshold": NAN, "loe_estimate": NAN, "loe_lower": NAN[:, 0], "loe_upper": NAN[:, 0]},
    "scalar residual": {"residual": np.sin(TIME), "threshold": np.ones(N)},
    "residuals without thresholds": {"residual": np.random.default_rng(0).normal(size=(N, 8)), "threshold": None},
    "nothing but an alarm": dict.fromkeys(("residual", "threshold", "loe_estimate", "faulty_rotor", "isolation_time")),
    "infinite threshold": {"threshold": np.full((N, 1), np.inf)},
    "alarm at once": {"detection": 0.0, "isolation": 0.0},
    "alarm at the end": {"detection": 10.0, "isolation": 10.0},
    "late alarm": {"detection": 9.5, "isolation": None, "rotor": 0},
    "fault from the start": {"faults": (FAULT | {"onset_s": 0.0},)},
    "estimators that never ran": {"isolation_residual": np.zeros((N, 4)), "isolation_threshold": NAN},
    "empty sets": {"set_lower": np.ones((N, 4)), "set_upper": np.zeros((N, 4))},
}


def page_data(flown) -> dict[str, Any]:
    """The data of a report, after a check that the page around it is whole."""
    html = report.html(flown, metrics.summarise(flown))
    assert html.startswith("<!DOCTYPE html>")
    assert html.rstrip().endswith("</html>")
    assert len(html.encode()) <= 6e6
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)[1])


def length(column: dict[str, str]) -> int:
    return len(base64.b64decode(column["base64"])) // {"float32": 4, "float64": 8}[column["dtype"]]


def check_references(data: dict[str, Any]) -> None:
    """Every trace names columns that exist and fit each other; every column is drawn; every axis has its range."""
    used = set()
    for figure in data["figures"]:
        for trace in figure["data"]:
            names = [trace[axis].removeprefix("-") for axis in "xyz" if isinstance(trace.get(axis), str)]
            used |= set(names)
            assert len({length(data["columns"][name]) for name in names}) <= 1, trace
        for name, axis in figure["layout"].items():
            if name.startswith(("xaxis", "yaxis")):
                assert axis["range"][0] < axis["range"][1], (figure["key"], name)
    assert used == set(data["columns"])


@pytest.mark.parametrize("name", ODD)
def test_an_odd_recording_has_a_report(name):
    check_references(page_data(recording(**ODD[name])))


def test_two_samples_are_enough():
    flown = recording()
    ends = {key: values[[0, -1]] for key, values in flown.signals.items()}
    check_references(page_data(replace(flown, time=flown.time[[0, -1]], signals=ends)))


def test_a_lost_position_does_not_lose_the_report():
    flown = circle_flight(duration=5.0, onset=2.5)
    flown.signals["plant.position"][:] = np.nan
    check_references(page_data(flown))


@pytest.mark.parametrize("count", [1, 2, 4])
def test_a_full_flight_stays_below_6_MB_also_with_several_diagnosers(count):
    flown = circle_flight()
    said = {key: values for key, values in flown.signals.items() if key.startswith("fdie.")}
    names = [f"d{i}" for i in range(count)]
    copies = {key.replace("fdie", name): values for name in names for key, values in said.items()}
    flown.measurements["step_time_ns"] = dict.fromkeys(names, 100.0)
    data = page_data(replace(flown, signals=flown.signals | copies, diagnosers=names))
    check_references(data)
    assert len(data["figures"]) == 3 + 4 * count


def test_channels_are_named_by_their_description_and_unit():
    flown = recording(residual=np.zeros((N, 4)), threshold=np.ones((N, 4)))
    flown.descriptions["d.residual"] = "epsilon of (19): v_z, p, q, r"
    flown.units["d.residual"] = "m/s, rad/s2"
    (detection,) = (figure for figure in page_data(flown)["figures"] if figure["key"] == "d-detection")
    titles = [
        axis["title"]["text"] for name, axis in detection["layout"].items() if "yaxis" in name and "title" in axis
    ]
    assert titles == ["v<sub>z</sub> (m/s)", "p (rad/s²)", "q (rad/s²)", "r (rad/s²)"]


def test_indices_stand_for_channels_without_names():
    flown = recording(residual=np.zeros((N, 2)), threshold=np.ones((N, 2)))
    (detection,) = (figure for figure in page_data(flown)["figures"] if figure["key"] == "d-detection")
    assert [detection["layout"][axis]["title"]["text"] for axis in ("yaxis", "yaxis3")] == ["[1]", "[2]"]


def test_messages_of_the_components_are_shown():
    flown = recording()
    flown.measurements["messages"] = {"esc": ["rotor <3> saturates"]}
    html = report.html(flown, metrics.summarise(flown))
    assert "Messages of esc" in html
    assert "rotor &lt;3&gt; saturates" in html
