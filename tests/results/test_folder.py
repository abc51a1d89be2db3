"""A result folder is written whole or not at all, and nothing that is not a result is ever overwritten."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest

from rotordx.orchestrator import metrics, report, results
from rotordx.orchestrator.errors import UserError
from tests.results.hand_made import recording

FILES = {"summary.json", "timeseries.parquet", "report.html"}
FLOWN = recording()
SUMMARY = metrics.summarise(FLOWN)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def fail(monkeypatch, module, name, error):
    def failing(*_, **__):
        raise error

    monkeypatch.setattr(module, name, failing)


def test_a_result_is_three_files(tmp_path):
    results.write(FLOWN, SUMMARY, tmp_path / "deep" / "result")
    assert set(contents(tmp_path / "deep" / "result")) == FILES
    assert os.listdir(tmp_path / "deep") == ["result"]
    assert json.loads((tmp_path / "deep" / "result" / "summary.json").read_text()) == SUMMARY


def test_an_empty_folder_is_filled(tmp_path):
    (tmp_path / "result").mkdir()
    results.write(FLOWN, SUMMARY, tmp_path / "result")
    assert set(contents(tmp_path / "result")) == FILES


def test_an_earlier_result_is_replaced(tmp_path):
    results.write(FLOWN, SUMMARY, tmp_path / "result")
    results.write(FLOWN, SUMMARY | {"seed": 8}, tmp_path / "result")
    assert json.loads((tmp_path / "result" / "summary.json").read_text())["seed"] == 8
    assert os.listdir(tmp_path) == ["result"]


INTERRUPTIONS = [KeyboardInterrupt(), MemoryError(), OSError(errno.ENOSPC, "No space left on device")]
STAGES = [(results, "write_timeseries"), (report, "html"), (Path, "write_text"), (Path, "rename"), (Path, "mkdir")]


@pytest.mark.parametrize("error", INTERRUPTIONS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize(("module", "name"), STAGES, ids=lambda part: getattr(part, "__name__", part))
@pytest.mark.parametrize("earlier", [False, True], ids=["new", "replacing"])
def test_an_interruption_leaves_what_was_there(tmp_path, monkeypatch, error, module, name, earlier):
    if earlier:
        results.write(FLOWN, SUMMARY, tmp_path / "result")
    before = {folder.name: contents(folder) for folder in tmp_path.iterdir()}
    with monkeypatch.context() as patch:
        fail(patch, module, name, error)
        with pytest.raises((type(error), UserError)):
            results.write(FLOWN, SUMMARY | {"seed": 8}, tmp_path / "result")
    assert {folder.name: contents(folder) for folder in tmp_path.iterdir()} == before


def test_an_interruption_between_the_two_renames_brings_the_earlier_result_back(tmp_path, monkeypatch):
    results.write(FLOWN, SUMMARY, tmp_path / "result")
    before = contents(tmp_path / "result")
    rename, renamed = Path.rename, []

    def interrupted_the_second_time(path, target):
        renamed.append(target)
        if len(renamed) == 2:
            raise KeyboardInterrupt
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", interrupted_the_second_time)
    with pytest.raises(KeyboardInterrupt):
        results.write(FLOWN, SUMMARY | {"seed": 8}, tmp_path / "result")
    assert contents(tmp_path / "result") == before
    assert os.listdir(tmp_path) == ["result"]


def test_a_full_disk_is_a_sentence_with_the_folder(tmp_path, monkeypatch):
    fail(monkeypatch, results, "write_timeseries", OSError(errno.ENOSPC, "No space left on device"))
    with pytest.raises(
        UserError, match=r"folder .*result cannot be written: no space left on device\. Choose .* --out"
    ):
        results.write(FLOWN, SUMMARY, tmp_path / "result")


def test_an_unwritable_place_is_a_sentence_with_the_folder(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    for place in (tmp_path / "file" / "result", Path("/proc/result")):
        with pytest.raises(UserError, match=rf"folder {place} cannot be written"):
            results.write(FLOWN, SUMMARY, place)
    assert contents(tmp_path) == {"file": b"not a folder"}


def test_a_read_only_parent_is_a_sentence_with_the_folder(tmp_path, monkeypatch):
    fail(monkeypatch, Path, "mkdir", PermissionError(errno.EACCES, "Permission denied"))  # the superuser never sees it
    with pytest.raises(UserError, match=r"result cannot be written: permission denied"):
        results.write(FLOWN, SUMMARY, tmp_path / "result")


def test_a_folder_with_other_things_is_left_alone(tmp_path):
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "thesis.tex").write_text("years of work")
    with pytest.raises(UserError, match=r"notes cannot be written: it holds other things .* thesis\.tex"):
        results.check_folder(tmp_path / "notes")
    with pytest.raises(UserError, match="thesis"):
        results.write(FLOWN, SUMMARY, tmp_path / "notes")
    assert contents(tmp_path / "notes") == {"thesis.tex": b"years of work"}


def test_a_file_in_its_place_is_left_alone(tmp_path):
    (tmp_path / "result").write_text("years of work")
    with pytest.raises(UserError, match="a file of that name"):
        results.write(FLOWN, SUMMARY, tmp_path / "result")
    assert (tmp_path / "result").read_text() == "years of work"


def test_the_summary_holds_nothing_that_json_lacks(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        results.write(FLOWN, SUMMARY | {"wall_time_s": float("nan")}, tmp_path / "result")
    assert os.listdir(tmp_path) == []
