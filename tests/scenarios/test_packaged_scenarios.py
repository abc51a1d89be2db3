"""Every packaged scenario flies its trajectory: it says what it is, begins on it and stays near it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotordx.fmus.reference.ports import TRAJECTORIES
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import Fault, Gusts, Scenario, load_scenario, scenario_names


def test_the_example_of_the_readme_is_a_scenario_and_shows_every_field(tmp_path):
    readme = (Path(__file__).parents[2] / "orchestrator" / "README.md").read_text(encoding="utf-8")
    example = readme.split("## Scenarios\n```toml\n")[1].split("```")[0]
    path = tmp_path / "an example.toml"
    path.write_text(example)
    scenario = load_scenario(path)
    assert scenario.name == "an_example"
    for field in (*Scenario.model_fields, *Fault.model_fields, *Gusts.model_fields):
        assert field in example or field in ("name", "connections"), field


def test_there_is_a_scenario_for_every_trajectory():
    assert {load_scenario(name).parameters["trajectory"] for name in scenario_names()} == set(TRAJECTORIES)


@pytest.mark.parametrize("name", scenario_names())
def test_it_says_what_it_is_in_one_line(name):
    assert 20 <= len(load_scenario(name).description) <= 120


@pytest.mark.parametrize("name", scenario_names())
def test_it_begins_on_its_trajectory_and_stays_near_it(name):
    scenario = load_scenario(name)
    flown = fly(scenario).signals
    error = flown["plant.position"] - flown["reference.position_reference"]
    drifts = scenario.parameters["trajectory"] == "roll_sine"  # roll is flown directly, only altitude is held
    sinks = len(scenario.faults) == 4  # all rotors lose thrust, until the controller has made up for it
    assert np.abs(error[0]).max() < 1e-9
    assert np.abs(error[:, 2]).max() < (2.5 if sinks else 0.15)
    swing = 9.81 * scenario.parameters["roll_amplitude"] / scenario.parameters["angular_rate"] ** 2 if drifts else 0.0
    assert np.abs(error[:, :2]).max() < (20.0 + swing if drifts else 0.6 if sinks else 0.3)
    velocity = flown["plant.velocity"][0] - flown["reference.velocity_reference"][0]
    assert drifts or np.abs(velocity).max() < 1e-3
