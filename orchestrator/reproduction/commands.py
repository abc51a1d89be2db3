"""The command `reproduce`: a paper's experiments, its claims beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rotordx.orchestrator import reproduction

if TYPE_CHECKING:
    from rotordx.orchestrator.reproduction import Reproduction

CLAIMS, PAGE = "claims.json", "reproduction.html"


@click.command("reproduce", short_help="Repeat a paper's experiments.")
@click.argument("papers", nargs=-1, type=click.Choice(reproduction.papers()))
@click.option("--seeds", type=click.IntRange(min=1), default=20, show_default=True, help="Noisy repetitions.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("results"), metavar="DIR", show_default=True)
def reproduce_command(papers: tuple[str, ...], seeds: int, out: Path) -> None:
    """Repeat the experiments of papers (all of them unless named) and print their claims beside what comes out here.

    Writes DIR/reproduce_PAPER with claims.json and reproduction.html, which has the figures.

    \b
    Examples:
      rotordx reproduce nguyen_hong
      rotordx reproduce ren rho_adaptive --seeds 100 --out results/papers
    """
    from rotordx.orchestrator import terminal
    from rotordx.orchestrator.folders import check_folder

    folders = {paper: out / f"reproduce_{paper}" for paper in papers or reproduction.papers()}
    for folder in folders.values():
        check_folder(folder, (CLAIMS, PAGE))
    for paper, folder in folders.items():
        with terminal.progress(f"reproducing {paper}", 1.0, unit="") as progress:
            result = reproduction.reproduce(paper, seeds, progress)
        _write(paper, result, folder)
        _show(paper, result, folder)


def _write(paper: str, result: Reproduction, folder: Path) -> None:
    import dataclasses
    import json

    from rotordx.orchestrator.folders import whole_folder
    from rotordx.orchestrator.reproduction import page

    claims = [dataclasses.asdict(claim) for claim in result.claims]
    facts = {"paper": paper, "citation": result.citation, "verdict": result.verdict, "claims": claims}
    with whole_folder(folder, (CLAIMS, PAGE)) as partial:
        (partial / CLAIMS).write_text(json.dumps(facts, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        (partial / PAGE).write_text(page.html(paper, result), encoding="utf-8")


def _show(paper: str, result: Reproduction, folder: Path) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    console.print(f"[bold]{escape(paper)}[/]: {escape(result.citation)}\n", soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("quantity", "paper", "here", "", "remark"):
        table.add_column(heading)
    words = {True: "[green]holds[/]", False: "[red]does not[/]", None: "plot only"}
    for claim in result.claims:
        cells = (escape(text) for text in (claim.quantity, claim.paper, claim.ours))
        table.add_row(*cells, words[claim.holds], escape(claim.remark))
    console.print(table)
    console.print(f"\n{escape(result.verdict)}", soft_wrap=True)
    console.print(f"figures: {folder / PAGE}\n", soft_wrap=True, markup=False)
