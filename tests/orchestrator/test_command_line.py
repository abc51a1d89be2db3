"""The command line does what its contract says, and ends with the promised exit codes and sentences."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner, Result
from foreign_fmu import build

from rotordx.fmus import diagnoser_ids, fmu_path, vehicle_names
from rotordx.orchestrator.cli import main
from rotordx.orchestrator.scenario import scenario_names

SHORT = ("--set", "duration_s=1.0", "--set", "faults[0].onset_s=0.5")


def rotordx(*arguments: str) -> Result:
    result = CliRunner().invoke(main, list(arguments))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_run_leaves_a_result_folder_and_says_where_the_report_is(tmp_path):
    result = rotordx("run", *SHORT)
    assert (result.exit_code, result.stderr) == (0, "avram_circle on lab_x: 1 s\n")
    folder = tmp_path / "results" / "avram_circle"
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "summary.json", "timeseries.parquet"]
    assert result.stdout.splitlines()[-1] == "report: results/avram_circle/report.html"
    assert "fdie" in result.stdout


def test_options_change_what_is_flown(tmp_path):
    arguments = ("-d", "null", "-d", "fdie", "--seed", "7", "--vehicle", "crazyflie", "--set", "faults[0].rotor=3")
    assert rotordx("run", "hover", *SHORT, *arguments, "--out", "here/there").exit_code == 0
    summary = json.loads((tmp_path / "here" / "there" / "summary.json").read_text())
    assert (summary["scenario"], summary["vehicle"], summary["seed"]) == ("hover", "crazyflie", 7)
    assert (summary["steps"], summary["step_size_s"], summary["duration_s"]) == (500, 0.002, 1.0)
    assert summary["faults"] == [{"rotor": 3, "onset_s": 0.5, "loss_of_effectiveness": 0.1, "profile": "abrupt"}]
    assert list(summary["diagnosers"]) == ["null", "fdie"]
    assert summary["wall_time_s"] > 0


def test_the_same_seed_gives_the_same_bytes_in_the_parquet_file(tmp_path):
    for out in ("one", "two"):
        assert rotordx("run", *SHORT, "--out", out).exit_code == 0
    assert rotordx("run", *SHORT, "--out", "three", "--seed", "2").exit_code == 0
    one, two, three = ((tmp_path / out / "timeseries.parquet").read_bytes() for out in ("one", "two", "three"))
    assert one == two
    assert one != three


def test_list_names_all_there_is():
    listed = rotordx("list").stdout
    names = {line.strip().split(" ")[0] for line in listed.splitlines()}
    assert names >= {*scenario_names(), *vehicle_names(), *diagnoser_ids(), "plant", "esc"}
    assert str(fmu_path("fdie", 2).parent) in listed


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("run", "avram_circel"), "'avram_circel' must be one of"),
        (("run", "--set", "faults[0].rotor=5"), "avram_circle: faults[0].rotor is 5 but must be a rotor, 1 to 4"),
        (("run", "--set", "duratoin_s=1"), "duratoin_s is not a known field"),
        (("run", "-d", "fdei"), "avram_circle: diagnosers[0] is 'fdei' but must be one of"),
        (("run", "--vehicle", "lab_y"), "lab_y"),
        (("run", "--seed", "one"), "Invalid value for '--seed': 'one' is not a valid integer."),
        (
            ("run", "--set", "components.plant.parameters.mass=nan"),
            "components.plant.parameters.mass: nan is no finite number",
        ),
        (("run", "--set", "components.plant.fmu=none.fmu"), "none.fmu cannot be read: No such file or directory"),
        (("rnu",), "there is no command rnu, did you mean run?"),
    ],
)
def test_a_users_mistake_ends_with_exit_code_2_and_a_sentence(arguments, sentence, tmp_path):
    result = rotordx(*arguments)
    assert result.exit_code == 2
    assert sentence in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.output
    assert not list(tmp_path.iterdir())


def test_a_failed_run_ends_with_exit_code_1_and_a_sentence(tmp_path):
    fmu = build(tmp_path, "extra", outputs=["y"], step='if (time > 0.2999) { LOG("gone"); return fmi2Error; }')
    result = rotordx("run", *SHORT, "--set", f"components.extra.fmu={fmu}")
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == "Error: extra failed at t = 0.3 s in doStep: error: gone"
    assert not (tmp_path / "results").exists()


def test_an_earlier_result_is_replaced_and_anything_else_is_not(tmp_path):
    assert rotordx("run", *SHORT, "--out", "mine").exit_code == 0
    assert rotordx("run", *SHORT, "--out", "mine", "--seed", "2").exit_code == 0
    assert json.loads((tmp_path / "mine" / "summary.json").read_text())["seed"] == 2
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "thesis.txt").write_text("years of work")
    result = rotordx("run", *SHORT, "--out", "precious")
    assert result.exit_code == 2
    assert "precious" in result.stderr
    assert [path.name for path in (tmp_path / "precious").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("command", ["run", "list", "replay", "identify"])
def test_every_command_has_help_with_an_example(command):
    result = rotordx(command, "--help")
    assert result.exit_code == 0
    assert f"rotordx {command}" in result.stdout.split("Example")[1]
