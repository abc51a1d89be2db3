"""The verdict says in one plain sentence what happened, bad news included."""

from __future__ import annotations

import numpy as np
import pytest

from rotordx.orchestrator import metrics, report
from rotordx.orchestrator.report.verdict import verdict
from tests.results.hand_made import FAULT, recording

INCIPIENT = FAULT | {"profile": "incipient"}
OTHER = FAULT | {"rotor": 4, "onset_s": 6.0}
ALWAYS = FAULT | {"onset_s": 0.0}
INTERVAL = {"loe_lower": np.full(101, 0.25), "loe_upper": np.full(101, 0.29)}
LOST = "Rotor 2 lost 30 % of its thrust at 4.00 s: "

CASES = {
    "right": ({}, "good", LOST + "detected after 500 ms, isolated to rotor 2 after 1.00 s, estimated at 0.280."),
    "with interval": (INTERVAL, "good", "estimated at 0.280 ± 0.030."),
    "no rotor": ({"isolation": None, "rotor": 0}, "fair", LOST + "detected after 500 ms, no rotor named."),
    "wrong rotor": ({"rotor": 3}, "bad", LOST + "detected after 500 ms, but rotor 3 was wrongly named after 1.00 s."),
    "unknown": ({"rotor": -1}, "bad", LOST + "detected after 500 ms, declared unlike any loss of a single rotor."),
    "missed": (
        {"detection": None, "isolation": None},
        "bad",
        LOST + "missed, no alarm until the end. Before it the residual peaked at 0.50 of its threshold.",
    ),
    "false alarm before": (
        {"detection": 2.0, "isolation": 2.5, "rotor": 1},
        "bad",
        "False alarm at 2.00 s, naming rotor 1, before any fault. Rotor 2 lost 30 % of its thrust at 4.00 s.",
    ),
    "incipient": ({"faults": (INCIPIENT,)}, "good", "Rotor 2 began to lose thrust at 4.00 s (incipient, 30 %): "),
    "two rotors, one named": ({"faults": (FAULT, OTHER)}, "fair", "Rotors 2 and 4 lost thrust, the first at 4.00 s: "),
    "two rotors, unknown": ({"faults": (FAULT, OTHER), "rotor": -1}, "good", "declared unlike any loss"),
    "again and again": ({"faults": (FAULT, FAULT | {"onset_s": 6.0})}, "good", "Rotor 2 failed 2 times, first at"),
    "from the start": ({"faults": (ALWAYS,), "truth": False}, "good", "Rotor 2 lost 30 % of its thrust from the start"),
    "healthy": (
        {"faults": (), "detection": None, "isolation": None, "peak": 0.7, "residual": np.full((101, 1), 1.42)},
        "good",
        "No fault: no alarm in 10 s, peak residual at 0.71 of its threshold.",
    ),
    "false alarm": (
        {"faults": (), "isolation": None, "rotor": 0},
        "bad",
        "False alarm at 4.50 s: there was no fault; no rotor named.",
    ),
    "truth unknown, silent": (
        {"faults": (), "truth": False, "detection": None, "isolation": None, "residual": None},
        "open",
        "No alarm in 10 s.",
    ),
    "truth unknown, alarm": (
        {"faults": (), "truth": False},
        "open",
        "Alarm at 4.50 s: rotor 2 named at 5.00 s, its loss estimated at 0.280. What really happened is not known.",
    ),
}


@pytest.mark.parametrize(("how", "state", "sentence"), CASES.values(), ids=CASES)
def test_verdict(how, state, sentence):
    flown = recording(**how)
    found = verdict(flown, metrics.summarise(flown), "d")
    assert found.state == state
    assert sentence in found.sentence


@pytest.mark.parametrize(("how", "state"), [case[:2] for case in CASES.values()], ids=CASES)
def test_a_verdict_is_good_exactly_if_the_figures_are(how, state):
    flown = recording(**how)
    score = metrics.summarise(flown)["diagnosers"]["d"]
    if score["false_alarm"] or score["isolation_correct"] is False:
        assert state in ("bad", "fair")
    if score["isolation_correct"]:
        assert state == "good"


@pytest.mark.parametrize(
    ("model", "phrase"), [(1.0, "takes it that one rotor failed"), (4.0, "four independent rotor losses"), (None, "")]
)
def test_the_report_says_how_a_diagnoser_comes_to_rotors(model, phrase):
    flown = recording(isolation_model=None if model is None else np.full(101, model))
    page = report.html(flown, metrics.summarise(flown))
    assert f'<span class="who">{", ".join(filter(None, ("d", phrase)))}</span>' in page
