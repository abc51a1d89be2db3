"""The commands `design` and `verify`: files, exit codes, and one sentence for what goes wrong."""

import json
import re
import subprocess
import sys
from importlib.metadata import entry_points
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.gains import synthesis
from rotordx.gains.commands import design_command, verify_command
from rotordx.gains.design import Design
from rotordx.orchestrator import healthy_flights


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda command, *arguments: CliRunner().invoke(command, arguments)


def test_both_commands_are_found_by_their_entry_points():
    commands = {entry.name: entry.load() for entry in entry_points(group="rotordx.commands")}
    assert commands["design"] is design_command
    assert commands["verify"] is verify_command


def test_help_needs_neither_solver_nor_casadi():
    code = "import sys, rotordx.gains.commands; print([m for m in ('cvxpy', 'casadi', 'numpy') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_design_is_written_proved_and_used_with_its_vehicle(run, tmp_path):
    (tmp_path / "mine.toml").write_text('base = "lab_x"\n[body]\nmass = 1.7\n', encoding="utf-8")
    made = run(design_command, "adaptive_thau", "--vehicle", "mine.toml")
    assert made.exit_code == 0, made.output
    path = tmp_path / "designs" / "mine" / "adaptive_thau.json"
    assert re.search(r"designed and proved in \d+\.\d s", made.output)
    assert load_design(load_vehicle("mine.toml"), "adaptive_thau") == json.loads(path.read_text(encoding="utf-8"))
    checked = run(verify_command, str(path))
    assert checked.exit_code == 0, checked.output
    assert "REFUSED" not in checked.output
    assert "exact" in checked.output

    (tmp_path / "mine.toml").write_text('base = "lab_x"\n[body]\nmass = 1.8\n', encoding="utf-8")
    stale = run(verify_command, str(path))
    assert stale.exit_code == 1
    assert "mass changed since the design; design it anew" in stale.output


def test_the_bounds_of_fdie_are_identified_from_simulated_flights(run, tmp_path, packaged):
    made = run(design_command, "fdie")
    assert made.exit_code == 0, made.output
    path = tmp_path / "designs" / "lab_x" / "fdie.json"
    assert json.loads(path.read_text(encoding="utf-8")) == packaged("lab_x", "fdie")
    assert run(verify_command, str(path)).exit_code == 0


def test_verify_checks_every_file_before_it_ends(run, tmp_path, packaged):
    good, bad = packaged("lab_x", "thau"), packaged("lab_x", "smo")
    bad["parameters"]["linear_gain"][0] += 1
    paths = []
    for document in (bad, good):
        path = tmp_path / f"{document['diagnoser']}.json"
        path.write_text(json.dumps(document), encoding="utf-8")
        paths.append(str(path))
    result = run(verify_command, *paths)
    assert result.exit_code == 1
    assert "the file was changed after it was written" in result.output
    assert paths[1] in result.output
    assert result.output.splitlines()[-1] == f"Error: refused: {paths[0]}"


def test_one_parameter_makes_a_faster_or_a_quieter_observer(run, tmp_path):
    figures = {}
    for speed in ("0.5", "1", "2"):
        result = run(design_command, "hinf", "--speed", speed, "--set", 'models=["tau3"]', "--out", speed)
        assert result.exit_code == 0, result.output
        document = json.loads((tmp_path / speed / "lab_x" / "hinf.json").read_text(encoding="utf-8"))
        figures[speed] = document["certificates"][0]["figures"]
    for axis in range(3):
        assert (
            figures["0.5"]["settling_time"][axis]
            > figures["1"]["settling_time"][axis]
            > figures["2"]["settling_time"][axis]
        )
        assert figures["0.5"]["noise_std"][axis] < figures["1"]["noise_std"][axis] < figures["2"]["noise_std"][axis]


def test_explain_says_what_is_solved_and_draws_the_trade_off(run, tmp_path):
    result = run(design_command, "fast_adaptive", "--explain")
    assert result.exit_code == 0, result.output
    assert "bounded real, corner 1: 24 x 24" in result.output
    assert "fault_rate = 0.3 1/s: weight of the faults' rate of change" in result.output
    assert "V' + 2 a V + |z|^2 < g^2 |w|^2" in result.output
    rows = re.findall(r"^ +([\d.]+) +([\d.]+) s +([\d.]+)$", result.output, re.MULTILINE)
    assert [row[0] for row in rows] == sorted((row[0] for row in rows), key=float)
    assert len(rows) >= 4
    noise = [float(row[2]) for row in rows]
    assert noise == sorted(noise)
    drawing = ElementTree.parse(tmp_path / "designs" / "lab_x" / "fast_adaptive.svg").getroot()
    assert sum(element.tag.endswith("circle") for element in drawing.iter()) == len(rows)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("nothing",), "there is nothing to design for nothing; choose among adaptive_thau, askf"),
        (("fdie", "--speed", "2"), "fdie is identified from healthy flights"),
        (("thau", "--vehicle", "nowhere"), "no packaged vehicle `nowhere`"),
        (("thau", "--set", "spead=2"), "did you mean speed"),
        (("hinf", "--set", 'models=["attitude4"]'), "[1, 1, 1, 1]"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_2(run, tmp_path, arguments, sentence):
    result = run(design_command, *arguments)
    assert result.exit_code == 2
    assert sentence in result.output
    assert result.output.startswith("Error: ")
    assert len(result.output.splitlines()) == 1
    assert not (tmp_path / "designs").exists()


@pytest.mark.parametrize("diagnoser", ["adaptive_thau", "fdie"])
def test_a_folder_that_cannot_be_written_is_named_with_the_remedy(run, tmp_path, monkeypatch, diagnoser):
    monkeypatch.setattr(healthy_flights, "identify_in_simulation", lambda vehicle: Design("fdie", vehicle, {}, {}))
    (tmp_path / "taken").write_text("a file")
    result = run(design_command, diagnoser, "--out", "taken")
    assert result.exit_code == 2
    path = f"taken/lab_x/{diagnoser}.json"
    assert result.output == f"Error: {path} cannot be written (Not a directory); choose another folder with --out\n"


def test_what_is_no_design_file_is_exit_code_2(run):
    result = run(verify_command, "nowhere.json")
    assert result.exit_code == 2
    assert "nowhere.json cannot be read" in result.output


def test_a_design_that_cannot_be_proved_is_not_written(run, tmp_path, monkeypatch):
    proof = synthesis._proof
    monkeypatch.setattr(synthesis, "_proof", lambda solution, gamma, *rest: proof(solution, gamma * 0.9, *rest))
    result = run(design_command, "adaptive_thau")
    assert result.exit_code == 1
    assert "is not written, its certificate fails: torques: bounded real, corner 1: violated" in result.output
    assert not (tmp_path / "designs").exists()
