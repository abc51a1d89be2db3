"""Each mistake in a scenario is refused in one sentence that names the file, the field and what is allowed."""

# ruff: noqa: E501
from __future__ import annotations

from pathlib import Path

import pytest

from rotordx.fmus import diagnoser_ids
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.scenario import load_scenario, scenario_names
from rotordx.orchestrator.system import System


def fault(change: str = "", without: str = "") -> str:
    """A table [[faults]] in which the lines of `change` replace those of the same key."""
    lines = {"rotor": "1", "onset_s": "1.0", "loss_of_effectiveness": "0.2"}
    lines |= dict(line.split(" = ") for line in change.splitlines())
    return "[[faults]]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items() if key != without)


#: lines after `duration_s = 1.0` -> the sentence without the file's name
DOCUMENTS = {
    "duratoin_s = 1.0": "duratoin_s is not a known field, it must be one of 15 names (did you mean duration_s?)",
    "step_size_s = 0.0": "step_size_s is 0.0 but must be a time in seconds, 1e-6 to 1",
    "step_size_s = 0.3": "duration_s, 1, must be a multiple of step_size_s, 0.3",
    "seed = -1": "seed is -1 but must be a whole number, 0 to 2^53",
    "seed = 1.5": "seed is 1.5 but must be a whole number, 0 to 2^53",
    "name = '../up'": "name is '../up' but must be letters, digits, '_', '-' and '.'",
    "diagnosers = ['fdei']": f"diagnosers[0] is 'fdei' but must be {one_of(diagnoser_ids(), 'fdei')}",
    "diagnosers = ['null', 'null']": "diagnosers[1] names null a second time",
    "gusts = 3": "gusts is 3 but must be true, false or a table",
    "gusts.std = [1.0, 2.0]": "gusts.std is [1.0, 2.0] but must be 6 standard deviations, each 0 or larger",
    "gusts.sdt = [1.0]": "gusts.sdt is not a known field, it must be one of std, time_constant_s, limit (did you mean std?)",
    "sensor_noise = 'no'": "sensor_noise is 'no' but must be true or false",
    "battery_sag_rate_per_s = -0.1": "battery_sag_rate_per_s is -0.1 but must be the relative loss of thrust of all rotors in 1/s, 0 to 1",
    "parameters.mass = nan": "parameters.mass: nan is no finite number, list of finite numbers or name of an enumeration's value",
    "parameters.inertia = [1, inf, 1]": "parameters.inertia: [1, inf, 1] is no finite number, list of finite numbers or name of an enumeration's value",
    "components.plant.fmi = 1": "components.plant.fmi is 1 but must be 2 or 3, the FMI version of a packaged FMU",
    "components.plant.parameter.mass = 1": "components.plant.parameter is not a known field, it must be one of fmu, fmi, parameters, ports, actual_vehicle, isolate, timeout_s, memory_mib, substeps (did you mean parameters?)",
    "connections = [{from = 'a.b'}]": 'connections[0].to is missing, it must be an input, "component.port"',
    fault(without="rotor"): "faults[0].rotor is missing, it must be a rotor, 1 to 4",
    fault("rotor = 5"): "faults[0].rotor is 5 but must be a rotor, 1 to 4",
    fault("rotor = 1.5"): "faults[0].rotor is 1.5 but must be a rotor, 1 to 4",
    fault(
        "loss_of_effectiveness = 1.5"
    ): "faults[0].loss_of_effectiveness is 1.5 but must be the lost fraction of the rotor's thrust, 0 to 0.99",
    fault("onset_s = -1.0"): "faults[0].onset_s is -1.0 but must be a time in seconds, 0 or later",
    fault("onset = 1.0"): "faults[0].onset is not a known field, it must be one of 12 names (did you mean onset_s?)",
    fault(
        "profile = 'sudden'"
    ): "faults[0].profile is 'sudden' but must be abrupt, incipient, function or intermittent",
    fault("profile = 'incipient'"): "faults[0]: the profile incipient needs growth_rate_per_s",
    fault("on_time_s = 1.0"): "faults[0]: on_time_s belongs to the profile intermittent, here the profile is abrupt",
    fault("end_s = 0.5"): "faults[0]: end_s, 0.5, must be later than onset_s, 1",
    fault()
    * 2: "faults[1].rotor: rotor 1 already fails at 1 s in faults[0], combine the two or give them different onsets",
    fault() * 9: "faults is a list of 9 but must be a list of at most 8 tables",
}

#: value of duration_s -> the sentence without the file's name
DURATIONS = {
    "-1.0": "duration_s is -1.0 but must be a time in seconds, above 0 and at most 36000",
    "1e6": "duration_s is 1000000.0 but must be a time in seconds, above 0 and at most 36000",
    "'long'": "duration_s is 'long' but must be a time in seconds, above 0 and at most 36000",
    "nan": "duration_s is nan but must be a time in seconds, above 0 and at most 36000",
}


def message_of(document: str, path: Path) -> str:
    path.write_text(document)
    with pytest.raises(UserError) as error:
        load_scenario(path)
    return str(error.value)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_a_wrong_document_gives_one_sentence(document, tmp_path):
    path = tmp_path / "mine.toml"
    assert message_of("duration_s = 1.0\n" + document, path) == f"{path}: {DOCUMENTS[document]}"


@pytest.mark.parametrize("duration", DURATIONS)
def test_a_wrong_duration_gives_one_sentence(duration, tmp_path):
    path = tmp_path / "mine.toml"
    assert message_of(f"duration_s = {duration}", path) == f"{path}: {DURATIONS[duration]}"


def test_a_missing_duration_gives_one_sentence(tmp_path):
    path = tmp_path / "mine.toml"
    sentence = "duration_s is missing, it must be a time in seconds, above 0 and at most 36000"
    assert message_of("seed = 1", path) == f"{path}: {sentence}"


def test_every_mistake_has_a_line_of_its_own(tmp_path):
    path = tmp_path / "mine.toml"
    lines = message_of("duration_s = 0.0\nseed = -1\n", path).splitlines()
    assert [line.split(" is ")[0] for line in lines] == [f"{path}: duration_s", f"{path}: seed"]


#: --set -> the sentence
OVERRIDES = {
    "faults[0].rotor=5": "avram_circle: faults[0].rotor is 5 but must be a rotor, 1 to 4",
    "faults[1].rotor=2": "--set faults[1].rotor=2: faults has 1 elements, counted from 0",
    "faults.rotor=2": "--set faults.rotor=2: faults is no table",
    "duration_s.x=1": "--set duration_s.x=1: duration_s is no table",
    "duration_s[0]=1": "--set duration_s[0]=1: duration_s is no list",
    "fautls[0].rotor=1": "--set fautls[0].rotor=1: there is no list fautls; give it whole, for example "
    "faults=[{rotor = 3, onset_s = 24.0, loss_of_effectiveness = 0.2}]",
    "durations=1": "avram_circle: durations is not a known field, it must be one of 15 names (did you mean duration_s?)",
    "seed": "--set seed: write PATH=VALUE, for example faults[0].rotor=3",
    "=1": "--set =1: write PATH=VALUE, for example faults[0].rotor=3",
}


@pytest.mark.parametrize("assignment", OVERRIDES)
def test_a_wrong_override_gives_one_sentence(assignment):
    with pytest.raises(UserError) as error:
        load_scenario("avram_circle", [assignment])
    assert str(error.value) == OVERRIDES[assignment]


def test_overrides_change_any_field():
    scenario = load_scenario(
        "avram_circle",
        [
            "faults[0].rotor = 3",
            "vehicle=crazyflie",
            "components.plant.parameters.gust_std=[0, 0, 0, 0, 0, 0.5]",
            "gusts=false",
            'diagnosers=["null"]',
        ],
        seed=9,
    )
    assert (scenario.faults[0].rotor, scenario.vehicle, scenario.seed) == (3, "crazyflie", 9)
    assert scenario.components["plant"].parameters["gust_std"][5] == 0.5
    assert (scenario.gusts, scenario.diagnosers) == (None, ["null"])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "avram_circel",
            r"'avram_circel' must be one of .*\(did you mean avram_circle\?\), or the path of a .toml file",
        ),
        ("missing.toml", "missing.toml cannot be read: No such file or directory"),
    ],
)
def test_an_unknown_scenario_is_refused(name, message):
    with pytest.raises(UserError, match=message):
        load_scenario(name)


def test_what_is_not_toml_is_refused(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("duration_s = = 1")
    with pytest.raises(UserError, match=rf"^{path} is not valid TOML: Invalid value \(at line 1"):
        load_scenario(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vehicle": "lab_y"}, "vehicle `lab_y`"),
        ({"system": "octorotor"}, "'octorotor' must be one of quadrotor, replay"),
        (
            {"components": {"plnt": {"parameters": {"mass": 1.0}}}},
            r"components.plnt must be one of .*\(did you mean plant\?\)",
        ),
        (
            {"components": {"plant": {"fmu": "plnt"}}},
            r"components.plant.fmu is 'plnt' but must be one of .*, or the path of",
        ),
        ({"components": {"plant": {"fmu": "missing.fmu"}}}, "missing.fmu cannot be read: No such file or directory"),
        (
            {"connections": [{"from": "plant.position", "to": "controller.positon"}]},
            r"'controller.positon': there is no",
        ),
    ],
)
def test_names_that_lead_nowhere_are_refused(changes, message):
    scenario = load_scenario("avram_circle", duration_s=1.0, **changes)
    with pytest.raises(UserError, match=f"^avram_circle: .*{message}"), System(scenario) as system:
        system.initialise(scenario)


@pytest.mark.parametrize("name", scenario_names())
def test_a_scenario_survives_being_stored_as_plain_data(name):
    scenario = load_scenario(name)
    assert scenario.changed() == scenario
