"""The command `export c`; what it needs is imported when it runs, so that --help is quick."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("c", short_help="Export a diagnoser as C99 for firmware.")
@click.argument("diagnoser", metavar="[ID]", required=False)
@click.option("--all", "everything", is_flag=True, help="Export every diagnoser, each into a folder of DIR.")
@click.option("--vehicle", default="lab_x", metavar="V", help="Packaged vehicle or path of a vehicle file [lab_x].")
@click.option(
    "--wrapper", "wrappers", multiple=True, type=click.Choice(("px4", "crazyflie", "rtos")), help="Repeatable."
)
@click.option("--step-size", type=float, metavar="S", help="Seconds between two samples [0.002].")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Folder [rotordx_c, or rotordx_ID].")
def c_command(
    diagnoser: str | None,
    everything: bool,
    vehicle: str,
    wrappers: tuple[str, ...],
    step_size: float | None,
    out: Path | None,
) -> None:
    """Write diagnoser ID for a vehicle as C99: source, example, self-test, build files, manifest.

    It is the source that the FMU is built from. There is no heap, no global state, and nothing of the C library but
    math.h; -DROTORDX_SINGLE makes it single precision.

    \b
    Examples:
      rotordx export c fdie
      rotordx export c fdie --vehicle my_craft.toml --wrapper px4 --out firmware/fdie
      rotordx export c --all --vehicle crazyflie --wrapper crazyflie
    """
    from rotordx.fmus import diagnoser_ids
    from rotordx.orchestrator.errors import UserError
    from rotordx.orchestrator.export import c_export
    from rotordx.orchestrator.export.subject import subject

    if (diagnoser is None) != everything:
        raise UserError(f"name one diagnoser, {', '.join(diagnoser_ids())}, or all of them with --all")
    if diagnoser is not None:
        folders = {diagnoser: out or Path(f"rotordx_{diagnoser}")}
    else:
        folders = {name: (out or Path("rotordx_c")) / name for name in diagnoser_ids()}
    for folder in folders.values():
        c_export.check_place(folder)
    step = {} if step_size is None else {"step_size": step_size}
    exports = {}
    for name in folders:
        click.echo(f"exporting {name} for {vehicle}", err=True)
        exports[name] = c_export.contents(subject(name, vehicle, **step), tuple(dict.fromkeys(wrappers)))
    for name, folder in folders.items():
        c_export.write(exports[name], folder)
        click.echo(f"{folder}: {len(exports[name])} files, see {folder / 'README.md'}")
