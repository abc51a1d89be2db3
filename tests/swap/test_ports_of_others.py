"""Ports of a foreign FMU are mapped: names, units, signs, and arrays against scalars; what does not fit is refused."""

from __future__ import annotations

import numpy as np
import pytest
from fmi3_fmu import Float64, build

from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import Scenario, load_scenario
from rotordx.orchestrator.system import System

UNITS = (
    '<Unit name="degree"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit>'
    '<Unit name="ft"/><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>'
)
#: echoes its inputs: `seen` are angles in degrees and what is left of `state`
VARIABLES = [
    Float64("state", "input", 6),
    Float64("angle", "input", 3, "degree"),
    Float64("height", "input", None, "ft"),
    Float64("seen", "output", 6),
    Float64("angle_seen", "output", 3, "degree"),
    Float64("height_seen", "output", None, "ft"),
    Float64("warm", "output", None, "degC"),
]
ECHO = """
  for (int i = 0; i < 6; ++i) V(seen)[i] = V(state)[i];
  for (int i = 0; i < 3; ++i) V(angle_seen)[i] = V(angle)[i];
  V(height_seen)[0] = V(height)[0];
  V(warm)[0] = 20.0;
"""
PORTS = {
    "position": {"variables": [f"state[{i}]" for i in (2, 1, 3)], "scale": [1.0, 1.0, -1.0]},  # ENU instead of NED
    "rate": {"variables": [f"state[{i}]" for i in (4, 5, 6)], "unit": "deg/s"},
    "position_seen": ["seen[1]", "seen[2]", "seen[3]"],
    "rate_seen": ["seen[4]", "seen[5]", "seen[6]"],
}
CONNECTIONS = [
    {"from": "plant.position", "to": "echo.position"},
    {"from": "plant.body_rate", "to": "echo.rate"},
    {"from": "plant.euler", "to": "echo.angle"},
    {"from": "plant.position[1]", "to": "echo.height"},
]


@pytest.fixture(scope="module")
def echo(tmp_path_factory):
    return build(tmp_path_factory.mktemp("echo"), "echo", VARIABLES, ECHO, UNITS)


def with_echo(echo, ports=PORTS, connections=CONNECTIONS, **settings) -> Scenario:
    components = {"echo": {"fmu": str(echo), "ports": ports} | settings}
    return load_scenario("avram_circle", duration_s=0.2, faults=[], components=components, connections=connections)


@pytest.mark.parametrize("isolate", [True, False])
def test_names_units_signs_and_elements_are_mapped(echo, isolate):
    flown = fly(with_echo(echo, isolate=isolate))
    signals = {key: values[1:] for key, values in flown.signals.items()}
    position = signals["plant.position"]
    assert np.array_equal(signals["echo.position_seen"], position[:, [1, 0, 2]] * [1, 1, -1])
    np.testing.assert_allclose(signals["echo.rate_seen"], np.degrees(signals["plant.body_rate"]), rtol=1e-15)
    np.testing.assert_allclose(signals["echo.angle_seen"], signals["plant.euler"], rtol=1e-15)  # there and back
    np.testing.assert_allclose(signals["echo.height_seen"], position[:, 0], rtol=1e-15)
    assert set(signals["echo.warm"]) == {293.15}
    units = {key.removeprefix("echo."): unit for key, unit in flown.units.items() if key.startswith("echo.")}
    assert units == {"angle_seen": "rad", "height_seen": "m", "warm": "K", "position_seen": "1", "rate_seen": "1"}


def test_scale_and_offset_act_on_si_values(echo):
    ports = PORTS | {"heat": {"variables": "warm", "scale": 2.0, "offset": 1.0}}
    assert set(fly(with_echo(echo, ports, isolate=False)).signals["echo.heat"][1:]) == {2 * 293.15 + 1}


def changed(**ports: object) -> dict[str, object]:
    return PORTS | ports


@pytest.mark.parametrize(
    ("ports", "connections", "message"),
    [
        (
            changed(rate={"variables": ["state[4]", "state[5]", "state[7]"]}),
            CONNECTIONS,
            r"components.echo.ports.rate is 'state\[7\]' but must be one of .*state\[\d\]",
        ),
        (
            changed(rate={"variables": ["state[4]", "state[5]", "state[6]"], "unit": "furlong"}),
            CONNECTIONS,
            "components.echo.ports.rate.unit is 'furlong' but must be a unit such as m/s, deg/s or rpm",
        ),
        (
            changed(tilt={"variables": "angle", "unit": "m"}),
            CONNECTIONS,
            "components.echo.ports.tilt.unit is 'm' but the FMU declares 'degree', leave it out",
        ),
        (
            changed(rate={"variables": ["state[4]", "state[5]", "state[6]"], "scale": [1.0, 2.0]}),
            CONNECTIONS,
            "components.echo.ports.rate.scale has 2 numbers, but the port has 3 elements",
        ),
        (
            changed(rate={"variables": ["state[4]", "state[5]", "state[1]"]}),
            CONNECTIONS,
            r"components.echo.ports.rate: state\[1\] is in the port position already, take one of the two out",
        ),
        (
            changed(mixed={"variables": ["angle[1]", "height"]}),
            CONNECTIONS,
            "components.echo.ports.mixed: the variables differ in unit, angle.1. in degree, height in ft",
        ),
        (
            PORTS,
            [*CONNECTIONS[:3], {"from": "plant.euler[1]", "to": "echo.height"}],
            r"connection from 'plant.euler\[1\]' to 'echo.height': the units do not fit, the output is in rad and the "
            r"input in m; connect something else, or state the right unit with components.plant.ports.euler",
        ),
        (
            {name: port for name, port in PORTS.items() if name != "rate"},
            [CONNECTIONS[0], *CONNECTIONS[2:]],
            r"the input echo.state\[4\] is not connected: add a table",
        ),
    ],
)
def test_what_does_not_fit_is_refused_with_its_path(echo, ports, connections, message):
    with pytest.raises(UserError, match=f"^avram_circle: {message}"):
        System(with_echo(echo, ports, connections))


@pytest.mark.parametrize(
    ("port", "message"),
    [
        ({"variables": "angle", "scale": 0}, "components.echo.ports.x.scale: a scale of 0 loses the value"),
        ({"variables": "angle", "sign": -1}, "components.echo.ports.x.sign is not a known field"),
        ({"variables": []}, r"components.echo.ports.x.variables is \[\] but must be a variable of the FMU"),
        (3, "components.echo.ports.x is 3 but must be a variable of the FMU"),
    ],
)
def test_a_port_that_makes_no_sense_is_refused_when_the_scenario_is_read(echo, port, message):
    with pytest.raises(UserError, match=message):
        with_echo(echo, {"x": port})
