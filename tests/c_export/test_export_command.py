"""`rotordx export c` writes a whole export or nothing, never over anything else, and says what it rests on."""

import hashlib
import json
import re

import pytest
from click.testing import CliRunner

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.vehicles import load_design, load_vehicle
from rotordx.gains.design import vehicle_hash
from rotordx.gains.flight_model import model_terms_hash
from rotordx.orchestrator.cli import main
from rotordx.orchestrator.export import c_export
from rotordx.orchestrator.export.subject import subject
from tests.c_export.table import FIGURES

pytestmark = pytest.mark.xdist_group("c_export_null")


def rotordx(*arguments, code=0):
    result = CliRunner().invoke(main, [*map(str, arguments)], prog_name="rotordx")
    assert result.exit_code == code, result.output
    return result.output


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_manifest_names_what_the_export_rests_on_and_consists_of(tmp_path):
    rotordx("export", "c", "hinf", "--vehicle", "crazyflie", "--wrapper", "rtos", "--out", tmp_path / "out")
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["vehicle"] == {"name": "crazyflie", "sha256": vehicle_hash(load_vehicle("crazyflie"))}
    assert manifest["design"] == {"certified": True, "digest": load_design("crazyflie", "hinf")["digest"]}
    assert manifest["model_terms_sha256"] == model_terms_hash()
    assert manifest["step_size_s"] == 0.002
    assert 0 < manifest["casadi_instructions"] <= 8000
    written = {str(name): hashlib.sha256(data).hexdigest() for name, data in contents(tmp_path / "out").items()}
    assert written.pop("manifest.json")
    assert written == manifest["files"]
    assert {"rotordx_hinf.c", "rotordx_hinf.h", "main.c", "rtos/rotordx_task.c", "LICENSE"} <= set(written)


def test_figures_belong_to_the_source_that_was_measured(monkeypatch):
    """An export of a source that has changed since names no figures rather than old ones."""
    document = json.loads(FIGURES.read_text())
    hashes = {name: figures["source_sha256"] for name, figures in document.items()}
    monkeypatch.setattr(c_export.c_source, "source_hash", hashes.get)
    assert c_export.measured("fdie") == document["fdie"]["targets"]
    monkeypatch.setattr(c_export.c_source, "source_hash", lambda _: "another")
    assert c_export.measured("fdie") is None


def test_same_export_same_bytes(tmp_path):
    for name in ("one", "two"):
        rotordx("export", "c", "null", "--out", tmp_path / name)
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_all_exports_every_diagnoser(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(c_export, "contents", lambda exported, wrappers: asked.append(exported) or {"file": "text"})
    monkeypatch.setattr("rotordx.orchestrator.export.subject.subject", lambda name, vehicle: (name, vehicle))
    rotordx("export", "c", "--all", "--vehicle", "crazyflie", "--out", tmp_path / "out")
    assert asked == [(name, "crazyflie") for name in diagnoser_ids()]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == diagnoser_ids()


def test_an_earlier_export_is_replaced_also_after_it_was_built(tmp_path):
    folder = tmp_path / "out"
    rotordx("export", "c", "fdie", "--wrapper", "px4", "--out", folder)
    (folder / "build").mkdir()
    (folder / "build" / "example").write_text("binary")
    rotordx("export", "c", "null", "--out", folder)
    assert (folder / "rotordx_null.c").is_file()
    assert not (folder / "rotordx_fdie.c").exists()
    assert not (folder / "px4").exists()


def test_what_the_user_wrote_is_not_replaced(tmp_path):
    folder = tmp_path / "out"
    rotordx("export", "c", "null", "--out", folder)
    (folder / "main.c").write_text("my own main")
    before = contents(folder)
    assert "main.c was changed since it was exported; copy" in rotordx("export", "c", "null", "--out", folder, code=2)
    assert contents(folder) == before


@pytest.mark.parametrize("name", ["notes.txt", "manifest.json"])
def test_another_folder_is_not_touched(name, tmp_path):
    (tmp_path / name).write_text("{}")
    said = rotordx("export", "c", "null", "--out", tmp_path, code=2)
    assert f"it holds other things than a result, such as {name}. Choose another one with --out" in said
    assert contents(tmp_path).keys() == {tmp_path.joinpath(name).relative_to(tmp_path)}


def test_interruption_leaves_what_was_there(tmp_path, monkeypatch):
    folder = tmp_path / "out"
    rotordx("export", "c", "null", "--out", folder)
    before = contents(folder)
    written = c_export.contents(subject("null", "lab_x"))
    texts = iter(written.items())

    def interrupted():
        yield next(texts)
        raise KeyboardInterrupt

    monkeypatch.setattr(c_export, "contents", lambda *_: type("Files", (), {"items": lambda self: interrupted()})())
    assert "interrupted" in rotordx("export", "c", "null", "--out", folder, code=1)
    assert contents(folder) == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["fdi"], r"'fdi' must be one of .*did you mean fdie"),
        ([], r"name one diagnoser, .*, or all of them with --all"),
        (["fdie", "--all"], r"name one diagnoser"),
        (["fdie", "--vehicle", "lab_y"], r"no packaged vehicle `lab_y` \(did you mean `lab_x`\?\)"),
        (["fdie", "--vehicle", "f450_plus", "--wrapper", "px4"], r"quad X, which f450_plus is not"),
        (["fdie", "--step-size", "0.0025", "--wrapper", "crazyflie"], r"ticks of 1 ms, which .*--step-size"),
        (["fdie", "--step-size", "0"], r"--step-size is 0 but must be from 0.0001 to 0.05 s"),
    ],
)
def test_impossible_requests_are_refused_in_a_sentence(arguments, sentence, tmp_path):
    said = rotordx("export", "c", *arguments, "--out", tmp_path / "out", code=2)
    assert re.search(sentence, said.replace("\n", " ")), said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_a_vehicle_without_a_design_is_refused(tmp_path):
    lab_x = load_vehicle("lab_x").files[0].read_text()
    (tmp_path / "mine.toml").write_text(lab_x)
    said = rotordx("export", "c", "fdie", "--vehicle", tmp_path / "mine.toml", "--out", tmp_path / "out", code=2)
    assert "gains for another vehicle must not fly: make one with `rotordx design fdie --vehicle" in said


def test_another_step_size_reaches_parameters_and_flight(tmp_path):
    rotordx("export", "c", "thau", "--step-size", 0.0025, "--out", tmp_path / "out")
    assert ".step_size = ROTORDX_REAL(0.0025)" in (tmp_path / "out" / "rotordx_thau.c").read_text()
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["step_size_s"] == 0.0025
