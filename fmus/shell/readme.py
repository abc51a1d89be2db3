"""Port tables of the components' READMEs: `python -m rotordx.fmus.shell.readme` rewrites them, `--check` compares.

The table replaces what stands between the lines `<!-- ports -->` and `<!-- /ports -->` of a component's README.md.
"""

from __future__ import annotations

import argparse
import math
import sys
from importlib.resources import files
from pathlib import Path

import rotordx.fmus
from rotordx.fmus.shell.ports import Component, Port

OPENING, CLOSING = "<!-- ports -->", "<!-- /ports -->"


def port_table(component: Component) -> str:
    """Markdown tables of a component's ports, one for each group in memory order."""
    titles = {"inputs": "Inputs", "step_size": "Step size", "outputs": "Outputs"}
    blocks = []
    for group, causality, ports in component.groups():
        if not ports:
            continue
        shown = causality != "output"
        header = ["name", "unit", *(["start", "range"] if shown else []), "meaning"]
        lines = [f"**{titles.get(group, group)}**\n", f"| {' | '.join(header)} |", "|" + "---|" * len(header)]
        for p in ports:
            name = f"`{p.name}`" if p.shape is None else f"`{p.name}[{p.shape}]`"
            cells = [name, p.unit, *([_start(p), _range(p)] if shown else []), p.description.replace("|", "\\|")]
            lines.append(f"| {' | '.join(cells)} |")
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def updated(text: str, component: Component) -> str:
    """README text with its port table rewritten.

    Raises:
        ValueError: if the text does not have the two marker lines once each, in order.
    """
    before, opening, rest = text.partition(f"{OPENING}\n")
    _, closing, after = rest.partition(f"{CLOSING}\n")
    if not opening or not closing or OPENING in after or CLOSING in after:
        raise ValueError(f"README of {component.name}: expected one line {OPENING} and after it one line {CLOSING}")
    return f"{before}{opening}\n{port_table(component)}\n\n{closing}{after}"


def readme_path(name: str) -> Path:
    """README.md of a component or diagnoser in the source tree."""
    package = "rotordx.fmus.diagnosers" if name in rotordx.fmus.diagnoser_ids() else "rotordx.fmus"
    return Path(str(files(package) / name / "README.md"))


def _start(p: Port) -> str:
    if p.choices:
        return p.choices[int(p.start[0])]
    values = [f"{value:.6g}" for value in p.start]
    return values[0] if len(set(values)) == 1 else ", ".join(values)


def _range(p: Port) -> str:
    if p.choices:
        return ", ".join(p.choices)
    low = -math.inf if p.minimum is None else p.minimum
    high = math.inf if p.maximum is None else p.maximum
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return "> 0" if 0 < low < 1e-9 else f"≥ {low:.6g}"
    return f"≤ {high:.6g}" if math.isinf(low) else f"{low:.6g} ... {high:.6g}"


def main() -> None:
    """Rewrite or check the tables of all components; exits with 1 if one is out of date or has no place to go."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing, fail if a table is out of date")
    check = parser.parse_args().check
    problems = []
    for name in rotordx.fmus.component_names() + rotordx.fmus.diagnoser_ids():
        path = readme_path(name)
        try:
            text = path.read_text(encoding="utf-8")
            new = updated(text, rotordx.fmus.load_component(name))
        except (OSError, ValueError) as error:
            problems.append(str(error))
            continue
        if new != text and check:
            problems.append(f"{path} is out of date, run python -m rotordx.fmus.shell.readme")
        elif new != text:
            path.write_text(new, encoding="utf-8")
    if problems:
        sys.exit("\n".join(problems))


if __name__ == "__main__":
    main()
