"""A diagnoser of another tool is scored and reported like ours, whatever the types of its verdict are."""

from __future__ import annotations

import numpy as np
import pytest
from fmi3_fmu import Port
from fmi3_fmu import build as build_fmi3

from rotordx.orchestrator import metrics, report
from rotordx.orchestrator.errors import RunError, UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.recording import Recording
from rotordx.orchestrator.report.verdict import verdict
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from tests.orchestrator.foreign_fmu import build

LOSSES = [f"loss{rotor}" for rotor in range(1, 5)]
FAULT = {"rotor": 3, "onset_s": 2.0, "loss_of_effectiveness": 0.3}


def fmi2_relay(folder, alarm: str, rotor: str):
    """Says what fdie says, in its own types."""
    return (
        build(
            folder,
            "relay",
            inputs=["a", "r", *(f"u{loss}" for loss in LOSSES)],
            outputs=["alarm", "rotor", *LOSSES],
            types={"a": alarm, "r": rotor, "alarm": alarm, "rotor": rotor},
            step="V(alarm) = V(a); V(rotor) = V(r);" + " ".join(f"V({loss}) = V(u{loss});" for loss in LOSSES),
        ),
        LOSSES,
        [f"u{loss}" for loss in LOSSES],
    )


def fmi3_relay(folder, alarm: str, rotor: str, loss: str):
    ports = [
        *(Port(name, "input", size, type=kind) for name, size, kind in _terminals(alarm, rotor, loss, "a", "r", "u")),
        *(
            Port(name, "output", size, type=kind)
            for name, size, kind in _terminals(alarm, rotor, loss, "alarm", "rotor", "losses")
        ),
    ]
    step = "*V(alarm) = *V(a); *V(rotor) = *V(r); for (int i = 0; i < 4; ++i) V(losses)[i] = V(u)[i];"
    return build_fmi3(folder, "relay", ports, step), "losses", "u"


def _terminals(alarm: str, rotor: str, loss: str, *names: str):
    return zip(names, (None, None, 4), (alarm, rotor, loss), strict=True)


def beside_fdie(relay, **changes) -> Scenario:
    fmu, losses, inputs = relay
    ports = {"fault_detected": "alarm", "faulty_rotor": "rotor", "loe_estimate": losses, "seen": inputs}
    return load_scenario(
        "avram_circle",
        duration_s=6.0,
        faults=[FAULT],
        diagnosers=["fdie", "relay"],
        components={"relay": {"fmu": str(fmu), "ports": ports | changes}},
        connections=[
            {"from": "fdie.fault_detected", "to": "relay.a"},
            {"from": "fdie.faulty_rotor", "to": "relay.r"},
            {"from": "fdie.loe_estimate", "to": "relay.seen"},
        ],
    )


@pytest.mark.parametrize(
    ("make", "types"),
    [
        (fmi2_relay, ("Boolean", "Integer")),
        (fmi2_relay, ("Integer", "Enumeration")),
        (fmi3_relay, ("Boolean", "Int32", "Float32")),
        (fmi3_relay, ("UInt8", "Enumeration", "Float64")),
    ],
)
def test_a_verdict_in_other_types_gets_the_same_score(tmp_path, make, types):
    recording = fly(beside_fdie(make(tmp_path, *types)))
    summary = metrics.summarise(recording)
    ours, theirs = (summary["diagnosers"][name] for name in ("fdie", "relay"))
    assert ours["isolation_correct"]
    single = "Float32" in types
    for figure in ours:
        if figure in ("step_time_ns", "peak_residual_ratio_before_fault"):
            continue
        close = pytest.approx(ours[figure], rel=1e-6 if single else 1e-12)
        expected = close if figure.startswith("loe") or figure.endswith("_s") else ours[figure]
        assert theirs[figure] == expected, figure
    assert theirs["step_time_ns"] > 0
    assert verdict(recording, summary, "relay").state == verdict(recording, summary, "fdie").state
    page = report.html(recording, summary)
    assert page.count("detected after") >= 2
    assert "relay" in page


@pytest.mark.parametrize(
    ("ports", "message"),
    [
        ({"loe_estimate": LOSSES[:3]}, "the output relay.loe_estimate has 3 elements but must have 4$"),
        (
            {"faulty_rotor": LOSSES, "loe_estimate": "rotor"},
            "the output relay.faulty_rotor has 4 elements but must have 1$",
        ),
        (
            {"residual": LOSSES, "threshold": "rotor", "loe_estimate": "r", "faulty_rotor": "a"},
            "the outputs relay.residual and relay.threshold have 4 and 1 elements but must have the same number$",
        ),
        (
            {"fault_detected": "a", "lamp": "alarm"},
            "the diagnoser relay has no output fault_detected: say under components.relay.ports which of its outputs "
            "that is, fault_detected = one of faulty_rotor, loe_estimate, lamp",
        ),
    ],
)
def test_a_verdict_that_cannot_be_scored_is_refused(tmp_path, ports, message):
    with pytest.raises(UserError, match=f"^avram_circle: {message}"):
        System(beside_fdie(fmi2_relay(tmp_path, "Boolean", "Integer"), **ports))


def recorded(**signals: list[float]) -> Recording:
    """Four samples of a diagnoser `d`, a fault of rotor 3 at 0.5 s."""
    values = {f"d.{port}": np.array(value, dtype=float) for port, value in signals.items()}
    texts = dict.fromkeys(values, "")
    return Recording(np.arange(4.0), values, texts, texts, {"duration_s": 3.0}, [FAULT | {"onset_s": 0.5}], ["d"])


def test_instants_are_those_of_the_first_alarm_and_of_the_last_naming():
    score = metrics.score(recorded(fault_detected=[0, 1, 0, 1], faulty_rotor=[0, 2, 3, 3]), "d")
    assert (score["detection_time_s"], score["isolation_time_s"], score["isolation_correct"]) == (1.0, 2.0, True)
    score = metrics.score(recorded(fault_detected=[0, 1, 1, 1], faulty_rotor=[0, 0, -1, -1]), "d")
    assert (score["detection_time_s"], score["isolation_time_s"], score["isolation_correct"]) == (1.0, None, False)
    score = metrics.score(recorded(fault_detected=[0, 0, 0, 0]), "d")
    assert (score["fault_detected"], score["detection_time_s"], score["isolation_time_s"]) == (False, None, None)


@pytest.mark.parametrize("rotor", [5.0, -2.0, 2.5])
def test_what_is_no_rotor_is_not_scored(rotor):
    with pytest.raises(RunError, match=rf"^d.faulty_rotor is {rotor:g} at the end but must be a rotor from 1 to 4"):
        metrics.score(recorded(fault_detected=[0, 1, 1, 1], faulty_rotor=[0, 1, rotor, rotor]), "d")
