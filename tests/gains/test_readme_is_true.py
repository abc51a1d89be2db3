"""The README of gains: its table is that of the packaged designs, its figure is drawn by the tool."""

from importlib import resources
from pathlib import Path

from rotordx.gains.commands import designable

README = Path(str(resources.files("rotordx.gains"))) / "README.md"
HEADING = "| diagnoser | proved | γ (smallest possible) | L_f, 1/s | spectral radius | settling, s | noise |"


def table(packaged):
    lines = [HEADING, "|---|---|---|---|---|---|---|"]
    for diagnoser in designable():
        for claim in packaged("lab_x", diagnoser)["certificates"]:
            proof, figures, model = claim["proof"], claim["figures"], claim["model"]
            gamma = f"{proof['gamma']:.4f} ({proof['gamma_optimum']:.4f})" if "gamma" in proof else ""
            lipschitz = f"{model['lipschitz']:.2f}" if "lipschitz" in model else ""
            radius = f"{figures['spectral_radius']:.4f}" if "spectral_radius" in figures else ""
            settling = f"{max(figures['settling_time']):.3f}" if "settling_time" in figures else ""
            noise = f"{max(figures['noise_std']):.4f}" if "noise_std" in figures else ""
            cells = [f"`{diagnoser}`", claim["name"], gamma, lipschitz, radius, settling, noise]
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def test_the_table_of_designs_is_that_of_the_packaged_ones(packaged):
    text = README.read_text(encoding="utf-8")
    assert table(packaged) in text, f"put this into {README.name}:\n{table(packaged)}"


def test_the_figure_of_the_readme_is_there():
    assert "](trade_off.svg)" in README.read_text(encoding="utf-8")
    assert (README.parent / "trade_off.svg").read_text(encoding="utf-8").startswith("<svg")
