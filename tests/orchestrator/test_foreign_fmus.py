"""An FMU that another tool has made can take any component's place, under its own variable names."""

from __future__ import annotations

import numpy as np
import pytest
from foreign_fmu import build

from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System

CALM = {"duration_s": 4.0, "gusts": False, "sensor_noise": False, "faults": [], "diagnosers": ["null"]}
RISE = {"trajectory": "hover", "centre": [0.0, 0.0, -2.5], "initial_position": [0.0, 0.0, -2.0]}

PORTS = {
    "position": ["meas.x", "meas.y", "meas.z"],
    "velocity": ["meas.vx", "meas.vy", "meas.vz"],
    "position_reference": ["ref.x", "ref.y", "ref.z"],
    "rotor_speed_command": ["cmd.w1", "cmd.w2", "cmd.w3", "cmd.w4"],
}
ALTITUDE_HOLD = """
  double upward = V(k) * (V(meas_z) - V(ref_z)) + V(d) * V(meas_vz);
  double speed = sqrt(fmax(0.0, 1.5 * (9.81 + upward) / (4 * 1.2e-5)));
  V(cmd_w1) = V(cmd_w2) = V(cmd_w3) = V(cmd_w4) = speed;
"""


@pytest.fixture(scope="module")
def altitude_hold(tmp_path_factory):
    inputs = [name for port in ("position", "velocity", "position_reference") for name in PORTS[port]]
    return build(
        tmp_path_factory.mktemp("foreign"),
        "altitude_hold",
        inputs=inputs,
        outputs=PORTS["rotor_speed_command"],
        parameters={"k": 1.0, "d": 1.0},
        step=ALTITUDE_HOLD,
        initialise=ALTITUDE_HOLD,
    )


def test_a_foreign_controller_flies_the_vehicle(altitude_hold):
    controller = {"fmu": str(altitude_hold), "ports": PORTS, "parameters": {"k": 6.0, "d": 4.0}}
    flown = fly(load_scenario("hover", parameters=RISE, components={"controller": controller}, **CALM)).signals
    assert flown["controller.rotor_speed_command"].shape == (2001, 4)
    assert flown["plant.position"][0, 2] == -2.0
    assert np.abs(flown["plant.position"][-1] - [0.0, 0.0, -2.5]).max() < 0.02


def test_a_foreign_fmu_is_found_relative_to_its_scenario(altitude_hold, tmp_path):
    (tmp_path / "own.fmu").write_bytes(altitude_hold.read_bytes())
    (tmp_path / "mine.toml").write_text(
        "duration_s = 0.01\n[components.controller]\nfmu = 'own.fmu'\n[components.controller.ports]\n"
        + "".join(f"{port} = {names}\n" for port, names in PORTS.items())
    )
    scenario = load_scenario(tmp_path / "mine.toml")
    assert fly(scenario).signals["controller.rotor_speed_command"].shape == (6, 4)


def test_a_foreign_fmu_can_be_an_additional_component(tmp_path, short):
    fmu = build(tmp_path, "squared", inputs=["u"], outputs=["y"], step="V(y) = V(u) * V(u);")
    scenario = short(
        components={"power": {"fmu": str(fmu)}},
        connections=[{"from": "esc.rotor_speed[2]", "to": "power.u"}],
    )
    flown = fly(scenario).signals
    assert np.array_equal(flown["power.y"][1:], flown["esc.rotor_speed"][1:, 1] ** 2)
    assert flown["power.y"].shape == (501,)


def test_a_foreign_diagnoser_is_wired_like_ours(tmp_path, short):
    inputs = ["a1", "a2", "a3", "a4", "phi", "theta", "psi", "p", "q", "r", "vz"]
    ports = {
        "rotor_speed_command": inputs[:4],
        "euler": inputs[4:7],
        "body_rate": inputs[7:10],
        "vertical_velocity": "vz",
    }
    fmu = build(tmp_path, "mine", inputs=inputs, outputs=["fault_detected"], step="V(fault_detected) = V(p);")
    scenario = short(diagnosers=["mine"], components={"mine": {"fmu": str(fmu), "ports": ports}})
    flown = fly(scenario)
    assert np.array_equal(flown.signals["mine.fault_detected"][1:], flown.signals["sensors.body_rate"][1:, 0])
    assert flown.measurements["step_time_ns"]["mine"] > 0


def test_an_input_without_connection_is_refused_by_name(altitude_hold):
    ports = {port: names for port, names in PORTS.items() if port != "velocity"}
    controller = {"fmu": str(altitude_hold), "ports": ports}
    with pytest.raises(UserError, match=r"^hover: the input controller.meas.vx is not connected: add a table"):
        System(load_scenario("hover", components={"controller": controller}, **CALM))


@pytest.mark.parametrize(
    ("ports", "message"),
    [
        ({"velocity": "meas.vel"}, r"components.controller.ports.velocity is 'meas.vel' but must be one of"),
        (
            {"velocity": ["meas.vx", "k"]},
            "components.controller.ports.velocity: the variables differ in type or causality",
        ),
    ],
)
def test_wrong_port_names_are_refused(altitude_hold, ports, message):
    with pytest.raises(UserError, match=message):
        System(load_scenario("hover", components={"controller": {"fmu": str(altitude_hold), "ports": ports}}, **CALM))
