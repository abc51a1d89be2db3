"""Every parameter reaches the FMU that it is meant for, in the promised precedence, or is refused by its path."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.parameters import parameter_values
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.system import System


def values_of(system: System, scenario: Scenario, actual_vehicle=None):
    vehicle = load_vehicle(scenario.vehicle)
    return parameter_values(scenario, system.settings(scenario), system.components, vehicle, actual_vehicle or vehicle)


def read(system: System, component: str, parameter: str) -> list[float]:
    """A parameter as the FMU holds it."""
    variable, fmu = system.components[component].variables[parameter], system.components[component].fmu
    return fmu.getFloat64(variable.references, variable.size)


def test_scenario_beats_design_beats_vehicle_beats_start(system, short, monkeypatch):
    design = {"parameters": {"mass": 2.0, "gravity": 2.0}}
    monkeypatch.setattr("rotordx.orchestrator.parameters.load_design", lambda vehicle, name: design)
    scenario = short(parameters={"gravity": 3.0}, vehicle="crazyflie")
    fdie = values_of(system, scenario)["fdie"]
    crazyflie = load_vehicle("crazyflie").parameters
    assert fdie["inertia"] == list(crazyflie["inertia"])
    assert (fdie["mass"], fdie["gravity"]) == ([2.0], [3.0])
    assert values_of(system, scenario)["plant"]["mass"] == [crazyflie["mass"]]  # a design is for its diagnoser


def test_gains_of_another_vehicle_do_not_pass_unnoticed(system, short, monkeypatch):
    def only_for_the_benchmark(vehicle, diagnoser):
        return {"parameters": {}} if getattr(vehicle, "name", vehicle) == "lab_x" and diagnoser == "fdie" else None

    monkeypatch.setattr("rotordx.orchestrator.parameters.load_design", only_for_the_benchmark)
    assert fly(short(vehicle="lab_x"), system).measurements["messages"] == {}
    said = fly(short(vehicle="crazyflie"), system).measurements["messages"]
    assert said == {"fdie": ["there is no design for crazyflie, this flight uses the gains for lab_x"]}


def test_a_components_own_settings_beat_all(short):
    scenario = short(parameters={"mass": 1.6}, components={"plant": {"parameters": {"mass": 1.7}}})
    with System(scenario) as system:
        values = values_of(system, scenario)
        assert (values["plant"]["mass"], values["controller"]["mass"]) == ([1.7], [1.6])
        system.initialise(scenario)
        assert (read(system, "plant", "mass"), read(system, "fdie", "mass")) == ([1.7], [1.6])


def test_a_vehicle_reaches_the_fmus(system, short):
    system.initialise(short(vehicle="crazyflie"))
    crazyflie = load_vehicle("crazyflie").parameters
    for name in ("controller", "esc", "plant", "fdie"):
        assert read(system, name, "rotor_x") == list(crazyflie["rotor_x"]), name


def test_only_the_world_knows_the_vehicle_as_it_is(system, short):
    lab_x = load_vehicle("lab_x")
    actual = dataclasses.replace(lab_x, parameters=lab_x.parameters | {"mass": 1.53, "battery_sag_rate": 1e-4})
    values = values_of(system, short(), actual)
    assert (values["plant"]["mass"], values["esc"]["battery_sag_rate"]) == ([1.53], [1e-4])
    assert (values["controller"]["mass"], values["fdie"]["mass"]) == ([1.5], [1.5])
    heavy, light = (fly(short(), system, actual_vehicle=a).signals["esc.rotor_speed"] for a in (actual, None))
    assert heavy[-1].sum() > light[-1].sum()


def test_seed_and_step_size_go_to_every_component_that_has_them(system, short):
    values = values_of(system, short(seed=77))
    assert {name: v["seed"] for name, v in values.items() if "seed" in v} == {"plant": [77], "sensors": [77]}
    assert all(v["step_size"] == [0.002] for v in values.values())


def test_faults_fill_the_slots_of_the_esc(system, short):
    faults = [
        {"rotor": 2, "onset_s": 0.1, "loss_of_effectiveness": 0.1, "profile": "incipient", "growth_rate_per_s": 3.0},
        {"rotor": 4, "onset_s": 0.2, "loss_of_effectiveness": 0.3, "end_s": 0.4},
    ]
    esc = values_of(system, short(faults=faults))["esc"]
    assert esc["fault_rotor"] == [2, 4, 0, 0, 0, 0, 0, 0]
    assert esc["fault_profile"][:2] == [1, 0]
    assert esc["fault_growth_rate"] == [3.0, 1, 1, 1, 1, 1, 1, 1]
    assert esc["fault_end"][:2] == [1e9, 0.4]
    loss = fly(short(faults=faults), system).signals["esc.loss_of_effectiveness"]
    assert loss[[100, 102, -1], 3] == pytest.approx([0.0, 0.3, 0.0])
    assert loss[-1, 1] == pytest.approx(0.1 * (1 - math.exp(-3 * 0.9)), abs=1e-3)


def test_gusts_and_sensor_noise_are_switched(system, short):
    gusts = {"std": [0.0] * 5 + [0.1], "time_constant_s": [0.2] * 6}
    plant = values_of(system, short(gusts=gusts))["plant"]
    assert (plant["gust_std"], plant["gust_time_constant"]) == ([0.0] * 5 + [0.1], [0.2] * 6)
    calm = fly(short(gusts=False, sensor_noise=False), system).signals
    assert not calm["plant.disturbance"].any()
    assert np.array_equal(calm["sensors.body_rate"], calm["plant.body_rate"])


def test_an_enumeration_is_given_by_name_or_number(system, short):
    assert values_of(system, short(parameters={"trajectory": "ellipse"}))["reference"]["trajectory"] == [4]
    assert values_of(system, short(parameters={"trajectory": 4}))["reference"]["trajectory"] == [4]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"components": {"plant": {"parameters": {"gust_sdt": 1}}}},
            r"plant.parameters.gust_sdt: .*did you mean gust_std",
        ),
        ({"parameters": {"masss": 1.0}}, r"parameters.masss: no component has a parameter masss.*did you mean mass\?"),
        ({"parameters": {"trajectory": "cirle"}}, r"parameters.trajectory is 'cirle' but must be one of hover, circle"),
        ({"parameters": {"trajectory": 17}}, "parameters.trajectory is 17 but must be one of hover"),
        ({"parameters": {"mass": -1.0}}, "parameters.mass is -1 but must be from 1e-12 to inf .kg: "),
        ({"parameters": {"tilt_limit": 2.0}}, r"parameters.tilt_limit is 2 but must be from 0 to 1 .rad: "),
        ({"parameters": {"mass": [1.0, 2.0]}}, "parameters.mass is .* but must be one value"),
        ({"parameters": {"inertia": [1.0, 2.0]}}, "parameters.inertia is .* but must be a list of 3 numbers"),
        ({"parameters": {"inertia": [1.0, 2.0, -3.0]}}, r"parameters.inertia\[2\] is -3 but must be from"),
        ({"parameters": {"mass": "heavy"}}, "parameters.mass is 'heavy' but must be a number"),
        (
            {"parameters": {"fault_rotor": [1] * 8}},
            "fault_rotor cannot be set .*: declare the fault in `faults`",
        ),
    ],
)
def test_what_does_not_fit_is_refused_by_its_path(changes, message, short):
    scenario = short(**changes)
    with System(scenario) as system, pytest.raises(UserError, match=f"^avram_circle: .*{message}"):
        system.initialise(scenario)


def test_faults_need_a_component_that_simulates_them(short):
    scenario = short(system="replay")
    with (
        System(scenario) as system,
        pytest.raises(UserError, match=r"faults: no component has"),
    ):
        system.initialise(scenario)


def test_a_system_refuses_a_scenario_of_another_structure(system, short):
    with pytest.raises(ValueError, match=r"other components or connections"):
        system.initialise(short(diagnosers=["null"]))
