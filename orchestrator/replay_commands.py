"""The commands `replay` and `identify`: diagnosers over recorded flights, and vehicles from healthy ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rotordx.fmus.vehicles import Vehicle
    from rotordx.orchestrator.logs import LoggedFlight

#: a rotor whose thrust is larger than the vehicle file says by this share speaks against the vehicle file
STALE = 0.05


@click.command("replay", short_help="Run diagnosers over recorded flights.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("--vehicle", required=True, metavar="V", help="Name of a packaged vehicle, or path of a vehicle file.")
@click.option("--signals", metavar="MAP", help="Signal mapping, packaged or a TOML file [the packaged one that fits].")
@click.option("-d", "--diagnoser", "diagnosers", multiple=True, metavar="ID", help="Repeatable [fdie].")
@click.option("--scenario", metavar="S", help="Take diagnosers, with parameters and ports, from a scenario.")
@click.option("--fault", "faults", multiple=True, metavar="ROTOR=LOSS", help="Known loss, to be scored; repeatable.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Result folder [results/LOG].")
def replay_command(
    logs: tuple[Path, ...],
    vehicle: str,
    signals: str | None,
    diagnosers: tuple[str, ...],
    scenario: str | None,
    faults: tuple[str, ...],
    out: Path | None,
) -> None:
    """Run the diagnoser FMUs over recorded flights, CSV or Parquet, and write a result folder for each.

    A diagnoser of another tool is replayed as the scenario has it that --scenario names.

    \b
    Examples:
      rotordx identify healthy*.csv --vehicle crazyflie --out my_craft.toml
      rotordx replay suspect.csv --vehicle my_craft.toml
      rotordx replay *.csv --vehicle my_craft.toml --signals my_log.toml -d fdie --out results/today
      rotordx replay suspect.csv --vehicle my_craft.toml --scenario my_scenario.toml
    """
    from rotordx.orchestrator import metrics, replay, results, terminal
    from rotordx.orchestrator.scenario import load_scenario

    likewise = load_scenario(scenario) if scenario else None
    chosen = diagnosers or (likewise and likewise.diagnosers) or ("fdie",)
    components = likewise.components if likewise else {}
    known = _known_losses(faults)
    folders = _result_folders(logs, out)
    _, flights = _read(logs, vehicle, signals)
    rows = []
    for flight, folder in zip(flights, folders, strict=True):
        recording = replay.replay(flight, vehicle, chosen, known, components)
        summary = metrics.summarise(recording)
        results.write(recording, summary, folder)
        if len(logs) == 1:
            terminal.show_result(recording, summary, folder)
        mean_loss = recording.scenario["replay"][replay.MEAN_LOSS]
        rows += [(flight, name, score, mean_loss) for name, score in summary["diagnosers"].items()]
    _show(rows)


@click.command("identify", short_help="Identify a vehicle from healthy flights.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("--vehicle", "base", required=True, metavar="BASE", help="Vehicle that gives what flights do not tell.")
@click.option("--signals", metavar="MAP", help="Signal mapping, packaged or a TOML file [the packaged one that fits].")
@click.option("--out", required=True, type=click.Path(path_type=Path), metavar="V.toml", help="Vehicle file to write.")
def identify_command(logs: tuple[Path, ...], base: str, signals: str | None, out: Path) -> None:
    """Identify rotor trim and sensor noise from healthy flights, and with them the bounds of the diagnosers.

    Writes the vehicle file and, beside it, the designs in designs/V/.

    \b
    Example:
      rotordx identify healthy1.csv healthy2.csv --vehicle crazyflie --out my_craft.toml
    """
    from rotordx.orchestrator.identification import identify

    believed, flights = _read(logs, base, signals)
    written = identify([part for flight in flights for part in flight.parts], believed, out)
    for flight in flights:
        for note in flight.notes:
            click.echo(f"{flight.path.name}: {note}")
    trim = written.trim
    for rotor, (effectiveness, spread) in enumerate(zip(trim.effectiveness, trim.repeatability, strict=True), start=1):
        click.echo(f"rotor {rotor}: {100 * effectiveness:.1f} % of the base's thrust, 1 sigma {100 * spread:.1f} %")
    for path in written.files:
        click.echo(f"written: {path}")


def _read(logs: tuple[Path, ...], vehicle: str, signals: str | None) -> tuple[Vehicle, list[LoggedFlight]]:
    """The vehicle and all logs, before anything is written."""
    from rotordx.fmus.vehicles import VehicleError, load_vehicle
    from rotordx.orchestrator.errors import UserError
    from rotordx.orchestrator.logs import read_flight
    from rotordx.orchestrator.signal_map import load_signal_map

    try:
        believed = load_vehicle(vehicle)
    except VehicleError as error:
        raise UserError(str(error)) from error
    signal_map = load_signal_map(signals) if signals else None
    return believed, [read_flight(log, signal_map, believed) for log in logs]


def _known_losses(faults: tuple[str, ...]) -> dict[int, float]:
    """ROTOR=LOSS texts as rotor -> loss."""
    from rotordx.orchestrator.errors import UserError

    losses = {}
    for fault in faults:
        rotor, _, loss = fault.partition("=")
        try:
            losses[int(rotor)] = float(loss)
        except ValueError:
            losses[0] = 0.0
        if not all(1 <= r <= 4 and 0 <= value < 1 for r, value in losses.items()):
            raise UserError(f"--fault {fault}: write ROTOR=LOSS with a rotor, 1 to 4, and a fraction, such as 3=0.18")
    return losses


def _result_folders(logs: tuple[Path, ...], out: Path | None) -> list[Path]:
    """A folder for each log: DIR itself for a single one, DIR/LOG for each of several; checked."""
    from rotordx.orchestrator import results
    from rotordx.orchestrator.errors import UserError

    folders = [out] if out and len(logs) == 1 else [(out or Path("results")) / log.stem for log in logs]
    if len(set(folders)) < len(folders):
        raise UserError("two logs have the same name, and so would have their results: replay them one by one")
    for folder in folders:
        results.check_folder(folder)
    return folders


def _show(rows: list[tuple[Any, ...]]) -> None:
    """One line for each log and diagnoser, and what speaks against the vehicle file."""
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("log", "airborne", "diagnoser", "alarm at", "rotor", "loss", "mean loss of rotors 1 to 4"):
        table.add_column(heading)
    notes = []
    for flight, diagnoser, score, balance in rows:
        airborne = sum(part.time[-1] - part.time[0] for part in flight.parts)
        rotor, alarm = score["faulty_rotor"], score["detection_time_s"]
        table.add_row(
            flight.path.name,
            f"{airborne:.1f} s",
            diagnoser,
            "-" if alarm is None else f"{alarm:.2f} s",
            {0: "-", -1: "unknown"}.get(rotor, str(rotor)),
            f"{100 * score['loe_estimate'][rotor - 1]:.1f} %" if rotor > 0 else "-",
            ", ".join(f"{100 * loss:+.1f}" for loss in balance) + " %",
        )
        notes += [f"{flight.path.name}: {note}" for note in flight.notes]
        notes += [
            f"{flight.path.name}: rotor {i} gave {-100 * loss:.0f} % more than the vehicle file says: identify it anew"
            for i, loss in enumerate(balance, start=1)
            if loss < -STALE
        ]
    console.print(table)
    for note in dict.fromkeys(notes):
        console.print(note, soft_wrap=True, markup=False)
