"""Numbers of every type of FMI 2 and 3 connect and are logged as doubles; what a type cannot hold ends the run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from fmi3_fmu import Port
from fmi3_fmu import build as build_fmi3

from rotordx.orchestrator.component import ComponentError
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System
from tests.orchestrator.foreign_fmu import build

#: FMI version -> type -> smallest and largest value; None of those that hold fractions
LIMITS: dict[int, dict[str, tuple[int, int] | None]] = {
    2: {"Real": None, "Integer": (-(2**31), 2**31 - 1), "Boolean": (0, 1), "Enumeration": (-(2**31), 2**31 - 1)},
    3: {
        "Float64": None,
        "Float32": None,
        **{f"Int{n}": (-(2 ** (n - 1)), 2 ** (n - 1) - 1) for n in (8, 16, 32, 64)},
        **{f"UInt{n}": (0, 2**n - 1) for n in (8, 16, 32, 64)},
        "Boolean": (0, 1),
        "Enumeration": (-(2**63), 2**63 - 1),
    },
}
INTEGERS = [(fmi, kind, limits) for fmi, types in LIMITS.items() for kind, limits in types.items() if limits]


@pytest.fixture(scope="module")
def echoes(tmp_path_factory):
    """FMU of either version whose output of each type is its input of that type; FMI 3 has a pair of each as well."""
    folder = tmp_path_factory.mktemp("echoes")
    (folder / "alone.toml").write_text("duration_s = 0.006\nsystem = 'nothing.toml'\n")
    (folder / "nothing.toml").write_text("")
    two, three = (list(types) for types in LIMITS.values())
    fmu2 = build(
        folder,
        "echo2",
        inputs=[f"in_{kind}" for kind in two],
        outputs=[f"out_{kind}" for kind in two],
        types={f"{end}_{kind}": kind for kind in two for end in ("in", "out")},
        step=" ".join(f"V(out_{kind}) = V(in_{kind});" for kind in two),
    )
    ports = [
        Port(f"{end}_{kind}{suffix}", causality, size, type=kind)
        for suffix, size in (("", None), ("_pair", 2))
        for kind in three
        for end, causality in (("in", "input"), ("out", "output"))
    ]
    copies = " ".join(
        f"for (int i = 0; i < {size}; ++i) V(out_{kind}{suffix})[i] = V(in_{kind}{suffix})[i];"
        for suffix, size in (("", 1), ("_pair", 2))
        for kind in three
    )
    return {2: fmu2, 3: build_fmi3(folder, "echo3", ports, copies)}


def echo_alone(fmu: Path, **settings: object) -> Scenario:
    """Three steps of an echo whose inputs all come from outside."""
    fmi = int(fmu.stem[-1])
    names = [f"in_{kind}{suffix}" for suffix in ([""] if fmi == 2 else ["", "_pair"]) for kind in LIMITS[fmi]]
    return load_scenario(
        fmu.parent / "alone.toml",
        components={"echo": {"fmu": str(fmu)} | settings},
        connections=[{"from": f"external.{name}", "to": f"echo.{name}"} for name in names],
    )


def flown(scenario: Scenario, values: dict[str, object], system: System | None = None) -> dict[str, np.ndarray]:
    """Signals of the echo; inputs without a value are 0."""
    sources = [connection.source for connection in scenario.connections]
    initial = {s: values.get(s.removeprefix("external."), [0, 0] if s.endswith("pair") else 0) for s in sources}
    return fly(scenario, system, initial=initial).signals


@pytest.mark.parametrize("isolate", [True, False])
@pytest.mark.parametrize("fmi", [2, 3])
def test_every_type_passes_from_input_to_output(echoes, fmi, isolate):
    values: dict[str, object] = {
        f"in_{kind}": 1 if kind == "Boolean" else 7.25 if limits is None else 100 + number
        for number, (kind, limits) in enumerate(LIMITS[fmi].items())
    }
    if fmi == 3:
        values |= {f"{name}_pair": [value, 0] for name, value in values.items()}
    signals = flown(echo_alone(echoes[fmi], isolate=isolate), values)
    outputs = {key for key in signals if key.startswith("echo.")}
    assert outputs == {f"echo.out{name.removeprefix('in')}" for name in values}
    for name, value in values.items():
        echoed = signals[f"echo.out{name.removeprefix('in')}"]
        assert not echoed[0].any()
        assert (echoed[1:] == value).all(), name


@pytest.mark.parametrize(("fmi", "kind", "limits"), INTEGERS)
def test_an_integer_takes_the_nearest_one_up_to_its_limits_and_nothing_beyond(echoes, fmi, kind, limits):
    scenario = echo_alone(echoes[fmi], isolate=False)
    lowest, highest = (float(limit) for limit in limits)
    if highest > limits[1]:  # the next double is too large
        highest = np.nextafter(highest, 0)
    with System(scenario) as system:

        def out(value: float) -> float:
            return flown(scenario, {f"in_{kind}": value}, system)[f"echo.out_{kind}"][-1]

        assert [out(value) for value in (0.4, 0.5, 0.6)] == [0, 1, 1]
        assert (out(lowest), out(highest)) == (lowest, highest)
        beyond = min(lowest - 0.6, np.nextafter(lowest, -np.inf)), max(highest + 0.6, np.nextafter(highest, np.inf))
        for value in (*beyond, np.nan, np.inf, -np.inf):
            sentence = (
                f"echo failed at t = 0 s in setting inputs: in_{kind} would be {value:g}, but the FMU takes {kind} "
                f"values from {lowest:.0f} to {highest:.0f}"
            )
            with pytest.raises(ComponentError, match=f"^{re.escape(sentence)}$"):
                out(value)


@pytest.mark.parametrize("isolate", [True, False])
def test_a_value_that_does_not_fit_is_named_with_its_element_and_time(echoes, isolate):
    scenario = echo_alone(echoes[3], isolate=isolate)
    rows = {c.source: np.zeros((4, 2 if c.source.endswith("pair") else 1)) for c in scenario.connections}
    rows["external.in_UInt8_pair"][2:, 1] = 256
    message = r"^echo failed at t = 0.002 s in setting inputs: in_UInt8_pair\[2\] would be 256, but the FMU takes UInt8"
    with pytest.raises(ComponentError, match=message):
        fly(scenario, external=rows)


def test_single_precision_is_rounded_to_and_keeps_what_is_not_finite(echoes):
    for value in (0.1, -1e300, np.nan, np.inf):
        with np.errstate(over="ignore"):
            expected = float(np.float32(value))
        signals = flown(echo_alone(echoes[3], isolate=False), {"in_Float32": value})
        assert np.array_equal(signals["echo.out_Float32"][1:], [expected] * 3, equal_nan=True)


@pytest.mark.parametrize("isolate", [True, False])
def test_initial_values_reach_every_type(tmp_path, isolate):
    """The initialisation passes values through the same calls as a step, in every flight."""
    fmu = build(
        tmp_path,
        "two",
        inputs=["count", "flag", "gain"],
        outputs=["total", "negation"],
        types={"count": "Integer", "flag": "Boolean", "total": "Integer", "negation": "Boolean"},
        initialise="V(total) = V(count) + V(gain); V(negation) = !V(flag);",
    )
    (tmp_path / "nothing.toml").write_text("")
    (tmp_path / "alone.toml").write_text("duration_s = 0.002\nsystem = 'nothing.toml'\n")
    connections = [{"from": f"external.{name}", "to": f"two.{name}"} for name in ("count", "flag", "gain")]
    components = {"two": {"fmu": str(fmu), "isolate": isolate}}
    scenario = load_scenario(tmp_path / "alone.toml", components=components, connections=connections)
    with System(scenario) as system:
        for count in (3, 4):
            signals = fly(
                scenario, system, initial={"external.count": count, "external.flag": 0, "external.gain": 2.0}
            ).signals
            assert (signals["two.total"][0], signals["two.negation"][0]) == (count + 2.0, 1.0)


def test_scale_and_unit_of_single_precision_are_converted(tmp_path):
    units = '<Unit name="degree"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit>'
    ports = [
        Port("angle", "input", 3, "degree", "Float32"),
        Port("seen", "output", 3, "degree", "Float32"),
        Port("count", "output", type="Int16"),
        Port("k", "parameter"),
    ]
    step = "for (int i = 0; i < 3; ++i) V(seen)[i] = V(angle)[i]; *V(count) += *V(k);"
    fmu = build_fmi3(tmp_path, "single", ports, step, units)
    mapped = {"attitude": {"variables": "angle", "scale": [1.0, -1.0, -1.0]}, "steps": "count", "gain": "k"}
    scenario = load_scenario(
        "avram_circle",
        duration_s=0.2,
        faults=[],
        components={"single": {"fmu": str(fmu), "ports": mapped, "parameters": {"gain": 2}}},
        connections=[{"from": "plant.euler", "to": "single.attitude"}],
    )
    recording = fly(scenario)
    seen, euler = (recording.signals[key][1:] for key in ("single.seen", "plant.euler"))
    np.testing.assert_allclose(seen, euler * [1, -1, -1], rtol=1e-6)
    assert not np.array_equal(seen, euler * [1, -1, -1])
    assert np.array_equal(recording.signals["single.steps"], 2 * np.arange(101))
    assert (recording.units["single.seen"], recording.units["single.steps"]) == ("rad", "1")


def test_integers_and_booleans_are_scaled_and_shifted(tmp_path):
    """Motors that count from 0, and a lamp that is on while all is well."""
    fmu = build(
        tmp_path,
        "theirs",
        inputs=["asked"],
        outputs=["motor", "healthy"],
        types={"asked": "Integer", "motor": "Integer", "healthy": "Boolean"},
        step="V(motor) = V(asked); V(healthy) = V(asked) < 0;",
    )
    ports = {
        "rotor": {"variables": "asked", "offset": 1},
        "faulty_rotor": {"variables": "motor", "offset": 1},
        "fault_detected": {"variables": "healthy", "scale": -1, "offset": 1},
    }
    (tmp_path / "nothing.toml").write_text("")
    (tmp_path / "alone.toml").write_text("duration_s = 0.002\nsystem = 'nothing.toml'\n")
    components = {"theirs": {"fmu": str(fmu), "isolate": False, "ports": ports}}
    connections = [{"from": "external.rotor", "to": "theirs.rotor"}]
    scenario = load_scenario(tmp_path / "alone.toml", components=components, connections=connections)
    for rotor in (0, 3):
        signals = fly(scenario, initial={"external.rotor": rotor}).signals
        assert signals["theirs.faulty_rotor"][-1] == rotor
        assert signals["theirs.fault_detected"][-1] == (rotor > 0)


def test_only_real_ports_have_a_unit(echoes):
    ports = {"mode": {"variables": "in_Int8", "unit": "m"}}
    with pytest.raises(UserError, match=r"components.echo.ports.mode.unit: Int8 values have no unit, leave it out"):
        System(echo_alone(echoes[3], ports=ports))


def test_parameters_are_not_converted(tmp_path):
    fmu = build(tmp_path, "scaled", outputs=["y"], parameters={"k": 1.0})
    scaled = {"fmu": str(fmu), "ports": {"gain": {"variables": "k", "scale": 2.0}}}
    message = (
        r"components.scaled.ports.gain.scale: only inputs and outputs that are numbers are converted, leave it out"
    )
    with pytest.raises(UserError, match=message):
        System(load_scenario("avram_circle", components={"scaled": scaled}))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (256, r"components.limited.parameters.level is 256 but must be from 0 to 255"),
        (-1, r"components.limited.parameters.level is -1 but must be from 0 to 255"),
        (2.5, r"components.limited.parameters.level is 2.5 but must be a whole number"),
    ],
)
def test_parameters_are_what_their_type_can_hold(tmp_path, value, message):
    ports = [Port("level", "parameter", type="UInt8"), Port("y", "output")]
    fmu = build_fmi3(tmp_path, "limited", ports, "*V(y) = *V(level);")
    (tmp_path / "nothing.toml").write_text("")
    (tmp_path / "alone.toml").write_text("duration_s = 0.002\nsystem = 'nothing.toml'\n")

    def scenario(level: float) -> Scenario:
        limited = {"fmu": str(fmu), "isolate": False, "parameters": {"level": level}}
        return load_scenario(tmp_path / "alone.toml", components={"limited": limited})

    assert fly(scenario(255)).signals["limited.y"][-1] == 255
    with pytest.raises(UserError, match=message):
        fly(scenario(value))


@pytest.mark.parametrize("isolate", [True, False])
def test_a_boolean_parameter_is_true_or_false(tmp_path, isolate):
    fmu = build(
        tmp_path, "lamp", outputs=["y"], parameters={"lit": 0.0}, types={"lit": "Boolean"}, step="V(y) = 5 * V(lit);"
    )
    (tmp_path / "nothing.toml").write_text("")
    (tmp_path / "alone.toml").write_text("duration_s = 0.002\nsystem = 'nothing.toml'\n")

    def scenario(lit: object) -> Scenario:
        lamp = {"fmu": str(fmu), "isolate": isolate, "parameters": {"lit": lit}}
        return load_scenario(tmp_path / "alone.toml", components={"lamp": lamp})

    assert fly(scenario(True)).signals["lamp.y"][-1] == 5
    with pytest.raises(UserError, match=r"components.lamp.parameters.lit is 1 but must be"):
        fly(scenario(1))
