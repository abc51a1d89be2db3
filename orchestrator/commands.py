"""The commands `list` and `run`; what they need is imported when they run, so that --help is quick."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("list", short_help="Show scenarios, vehicles, diagnosers and FMUs.")
def list_command() -> None:
    """Show the packaged scenarios, vehicles, diagnosers and FMUs.

    \b
    Example:
      rotordx list
    """
    from rotordx.orchestrator import inventory

    for title, entries in inventory.everything().items():
        click.echo(click.style(title, bold=True))
        width = max(map(len, entries), default=0)
        for name, description in entries.items():
            click.echo(f"  {name:{width}}  {description}".rstrip())


@click.command("run", short_help="Fly a scenario and diagnose it.")
@click.argument("scenario", default="avram_circle")
@click.option("-d", "--diagnoser", "diagnosers", multiple=True, metavar="ID", help="Fly this diagnoser; repeatable.")
@click.option("--vehicle", metavar="V", help="Name of a packaged vehicle, or path of a vehicle file.")
@click.option("--seed", type=int, metavar="N", help="Seed of gusts and sensor noise.")
@click.option("--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Change a field; repeatable.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Result folder [results/SCENARIO].")
def run_command(
    scenario: str,
    diagnosers: tuple[str, ...],
    vehicle: str | None,
    seed: int | None,
    overrides: tuple[str, ...],
    out: Path | None,
) -> None:
    """Fly SCENARIO: a packaged name, a TOML file or an SSP archive.

    It writes summary.json, timeseries.parquet and report.html.

    \b
    Examples:
      rotordx run
      rotordx run avram_circle -d fdie --seed 7 --set faults[0].rotor=3
      rotordx run my_scenario.toml --set components.plant.parameters.mass=1.6 --out results/heavy
    """
    from rotordx.orchestrator import metrics, results, terminal
    from rotordx.orchestrator.flight import fly
    from rotordx.orchestrator.scenario import load_scenario

    flown = load_scenario(scenario, overrides, diagnosers=list(diagnosers) or None, vehicle=vehicle, seed=seed)
    folder = out or Path("results") / flown.name
    results.check_folder(folder)
    with terminal.progress(f"{flown.name} on {flown.vehicle}", flown.duration_s) as progress:
        recording = fly(flown, progress=progress)
    summary = metrics.summarise(recording)
    results.write(recording, summary, folder)
    terminal.show_result(recording, summary, folder)
