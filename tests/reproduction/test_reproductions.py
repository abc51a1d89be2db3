"""`rotordx reproduce`: what it prints and writes is what was found."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from rotordx.orchestrator.cli import main
from rotordx.orchestrator.reproduction import Claim, Reproduction, curves, page, papers, reproduce
from tests.report.browser import CHROMIUM, NO_CHROMIUM, browser, new_page

HOSTILE = "a < b & </script><script>alert(1)</script>"


@pytest.fixture(scope="module", params=papers())
def result(request, tmp_path_factory):
    """A paper reproduced with two seeds, its output and its folder."""
    out = tmp_path_factory.mktemp("results")
    run = CliRunner().invoke(main, ["reproduce", request.param, "--seeds", "2", "--out", str(out)])
    assert run.exit_code == 0, run.output
    return request.param, run.output, out / f"reproduce_{request.param}"


def test_every_claim_is_written_and_has_the_papers_words_beside_ours(result):
    paper, output, folder = result
    facts = json.loads((folder / "claims.json").read_text())
    assert facts["paper"] == paper
    assert facts["citation"] in output.replace("\n", " ")
    assert facts["verdict"]
    assert len(facts["claims"]) >= 3
    for claim in facts["claims"]:
        assert all(claim[field] for field in ("quantity", "paper", "ours"))
        assert claim["holds"] in (True, False, None)
        if claim["holds"] is False:
            assert claim["remark"], f"{claim['quantity']} does not hold: why?"


@pytest.mark.skipif(CHROMIUM is None, reason=NO_CHROMIUM)
def test_the_page_draws_all_figures_and_asks_for_nothing(result):
    _, _, folder = result
    page_file = folder / "reproduction.html"
    with browser() as port, new_page(port) as page:
        page.open(page_file)
        assert page.problems == []
        assert page.requests == [page_file.resolve().as_uri()]
        figures = page.run("document.querySelectorAll('figure').length")
        assert figures >= 3
        assert page.run("document.querySelectorAll('figure .main-svg').length") >= figures


def test_texts_of_any_kind_do_not_break_the_page():
    claim = Claim(HOSTILE, HOSTILE, HOSTILE, False, HOSTILE)
    figure = curves(HOSTILE, HOSTILE, "x", "y", {HOSTILE: ([0, 1], [0, float("nan")])})
    text = page.html("paper", Reproduction(HOSTILE, HOSTILE, [claim], [figure]))
    assert "</script><script>alert" not in text


def test_a_paper_that_is_not_there_is_refused_with_those_that_are():
    run = CliRunner().invoke(main, ["reproduce", "nobody"])
    assert run.exit_code == 2
    assert "avram" in run.output


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    folder = tmp_path / "reproduce_avram"
    folder.mkdir()
    (folder / "thesis.tex").write_text("precious")
    run = CliRunner().invoke(main, ["reproduce", "avram", "--out", str(tmp_path)])
    assert run.exit_code == 2
    assert "thesis.tex" in run.output
    assert (folder / "thesis.tex").read_text() == "precious"


def test_more_seeds_are_more_flights():
    assert "3 flights" in reproduce("avram", seeds=3).claims[0].ours
