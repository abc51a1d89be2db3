"""`rotordx identify` and `rotordx replay` go from logs to a verdict, and tell in a sentence what they cannot use."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from rotordx.orchestrator.cli import main
from tests.replay.conftest import foreign_log_of


@pytest.fixture
def rotordx(tmp_path, monkeypatch):
    """Function that runs a command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return run


@pytest.fixture
def log(broken_rotor, write_csv):
    return write_csv(foreign_log_of(broken_rotor), "flight.csv")


@pytest.fixture
def signals(write_map, mapping):
    return write_map(mapping)


def test_one_log_gives_a_result_folder_and_a_verdict(rotordx, log, signals, craft, tmp_path):
    result = rotordx("replay", log, "--vehicle", craft, "--signals", signals, "--out", "result")
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "result").iterdir()} == {
        "summary.json",
        "timeseries.parquet",
        "report.html",
    }
    score = json.loads((tmp_path / "result" / "summary.json").read_text())["diagnosers"]["fdie"]
    assert score["faulty_rotor"] == 3
    assert "flight.csv" in result.output


def test_several_logs_give_a_folder_each_and_one_table(rotordx, log, signals, craft, tmp_path):
    other = tmp_path / "second.csv"
    other.write_bytes(log.read_bytes())
    result = rotordx(
        "replay", log, other, "--vehicle", craft, "--signals", signals, "-d", "fdie", "-d", "null", "--fault", "3=0.2"
    )
    assert result.exit_code == 0, result.output
    for name in ("flight", "second"):
        summary = json.loads((tmp_path / "results" / name / "summary.json").read_text())
        assert set(summary["diagnosers"]) == {"fdie", "null"}
        assert summary["faults"][0]["loss_of_effectiveness"] == 0.2
    assert result.output.count("fdie") == 2


def test_diagnosers_and_their_parameters_come_from_a_scenario(rotordx, log, signals, craft, tmp_path):
    # a bound that no acceleration reaches, so that only a parameter which arrives keeps fdie silent
    (tmp_path / "deaf.toml").write_text(
        "duration_s = 1.0\ndiagnosers = ['fdie', 'null']\n"
        "[components.fdie.parameters]\nbound_constant = [1e3, 1e3, 1e3, 1e3]\n"
    )
    result = rotordx("replay", log, "--vehicle", craft, "--signals", signals, "--scenario", "deaf.toml")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "results" / "flight" / "summary.json").read_text())
    assert list(summary["diagnosers"]) == ["fdie", "null"]
    assert not summary["diagnosers"]["fdie"]["fault_detected"]


def test_healthy_logs_become_a_vehicle_that_a_replay_takes(rotordx, broken_rotor, write_csv, signals, tmp_path):
    healthy = write_csv({k: v[broken_rotor.time < 6.0] for k, v in foreign_log_of(broken_rotor).items()}, "healthy.csv")
    result = rotordx("identify", healthy, "--vehicle", "lab_x", "--signals", signals, "--out", "mine.toml")
    assert result.exit_code == 0, result.output
    assert "rotor 1: 100." in result.output or "rotor 1: 99." in result.output
    result = rotordx("replay", healthy, "--vehicle", "mine.toml", "--signals", signals)
    assert result.exit_code == 0, result.output
    score = json.loads((tmp_path / "results" / "healthy" / "summary.json").read_text())["diagnosers"]["fdie"]
    assert not score["fault_detected"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vehicle", "lab_y"], "there is no packaged vehicle `lab_y`"),
        (["--vehicle", "lab_x"], "flight.csv: no packaged signal mapping fits"),
        (["--vehicle", "lab_x", "--signals", "SIGNALS", "-d", "fdy"], "diagnosers[0] is 'fdy' but must be one of"),
        (["--vehicle", "lab_x", "--signals", "SIGNALS", "--fault", "5=0.1"], "--fault 5=0.1: write ROTOR=LOSS"),
        (["--vehicle", "lab_x", "--signals", "SIGNALS", "--scenario", "hovr"], "did you mean hover?"),
        (["--vehicle", "lab_x", "--signals", "SIGNALS", "--fault", "x"], "--fault x: write ROTOR=LOSS"),
        (["--vehicle", "lab_x", "--signals", "SIGNALS", "--out", "taken"], "The result folder"),
        (["LOG", "--vehicle", "lab_x", "--signals", "SIGNALS"], "two logs have the same name"),
        (["absent.csv", "--vehicle", "lab_x", "--signals", "SIGNALS"], "absent.csv: cannot be read"),
    ],
)
def test_what_cannot_be_used_is_told_in_a_sentence(rotordx, log, signals, tmp_path, arguments, message):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "thesis.tex").write_text("")
    given = [{"SIGNALS": signals, "LOG": log}.get(argument, argument) for argument in arguments]
    result = rotordx("replay", log, *given)
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
    assert "Traceback" not in result.output
    assert not (tmp_path / "results").exists()
