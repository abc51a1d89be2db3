"""A reproduction as one self-contained interactive page."""

from __future__ import annotations

import json
from html import escape
from importlib.resources import files

from rotordx.orchestrator.report import page_of
from rotordx.orchestrator.reproduction import Claim, Figure, Reproduction

#: class of the page's style, and word, of a claim that holds, does not hold, cannot be decided
STATES = {True: ("good", "holds"), False: ("bad", "does not hold"), None: ("open", "plot only")}


def html(paper: str, reproduction: Reproduction) -> str:
    """The page; it works without a network and asks for nothing."""
    figures = [json.loads(f.figure.to_json()) for f in reproduction.figures]
    for figure in figures:
        figure["layout"].pop("template", None)  # the page has its own colours
    parts = {
        "title": escape(f"Reproduction of {paper}"),
        "citation": escape(reproduction.citation),
        "verdict": escape(reproduction.verdict),
        "claims": "\n".join(map(_claim, reproduction.claims)),
        "figures": "\n".join(_figure(index, figure) for index, figure in enumerate(reproduction.figures)),
        "data": json.dumps(figures, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
    }
    return page_of((files(__package__) / "page.html").read_text(encoding="utf-8"), parts)


def _claim(claim: Claim) -> str:
    style, word = STATES[claim.holds]
    cells = "".join(f"<td>{escape(text)}</td>" for text in (claim.paper, claim.ours))
    state = f'<td class="state {style}">{word}</td>'
    return f"<tr><th>{escape(claim.quantity)}</th>{cells}{state}<td>{escape(claim.remark)}</td></tr>"


def _figure(index: int, figure: Figure) -> str:
    return (
        f"<figure><h2>{escape(figure.title)}</h2><p>{escape(figure.caption)}</p>"
        f'<div class="plot" id="figure-{index}"></div></figure>'
    )
