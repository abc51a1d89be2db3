"""The commands `export fmu` and `export ssp`; what they need is imported when they run, so that --help is quick."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("fmu", short_help="Export an FMU for other tools.")
@click.argument("name")
@click.option("--vehicle", default="lab_x", metavar="V", help="Packaged vehicle or path of a vehicle file [lab_x].")
@click.option("--fmi", type=click.Choice(("2", "3")), default="3", help="Major version of FMI [3].")
@click.option(
    "--platforms",
    metavar="P,P,...",
    help="Of linux64, win64, darwin64, aarch64-linux, aarch64-darwin; others than this machine's need "
    "`pip install 'rotordx[platforms]'` [this machine's].",
)
@click.option("--sources", "with_sources", is_flag=True, help="Add the C and C++ with a build description.")
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="The FMU to write [NAME.fmu].")
def fmu_command(name: str, vehicle: str, fmi: str, platforms: str | None, with_sources: bool, out: Path | None) -> None:
    """Write component or diagnoser NAME as an FMU whose start values are those of a vehicle and its design.

    It holds documentation, icon and licence; the same export gives the same bytes. What is compiled for other platforms
    runs on Windows 10, macOS 11, Linux with glibc 2.17, and newer ones.

    \b
    Examples:
      rotordx export fmu fdie
      rotordx export fmu plant --vehicle crazyflie --fmi 2 --platforms linux64,win64 --out crazyflie_plant.fmu
      rotordx export fmu fdie --sources
    """
    from rotordx.orchestrator.export import fmu_export
    from rotordx.orchestrator.export.fmu_compiler import chosen_platforms

    chosen = chosen_platforms(platforms, int(fmi))
    component, craft = fmu_export.parametrised(name, vehicle)
    path = out or Path(f"{name}.fmu")
    fmu_export.check_place(path)
    files = fmu_export.contents(
        component, craft, int(fmi), chosen, with_sources, lambda text: click.echo(text, err=True)
    )
    fmu_export.write(files, path)
    where = ", ".join(p.name for p in chosen)
    click.echo(f"{path}: FMI {fmi}, {where}, start values for {craft.name}, {path.stat().st_size / 1024:.0f} kB")


@click.command("ssp", short_help="Export a scenario's system for other tools.")
@click.argument("scenario", default="avram_circle")
@click.option("--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Change a field; repeatable.")
@click.option(
    "--outputs",
    is_flag=True,
    help="Make all outputs outputs of the system: for container FMUs, not for Ecos and libcosim.",
)
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="The archive to write [SCENARIO.ssp].")
def ssp_command(scenario: str, overrides: tuple[str, ...], outputs: bool, out: Path | None) -> None:
    """Write the system of SCENARIO as System Structure and Parameterization 1.0.

    It holds the FMUs (FMI 2) with the scenario's values as start values, their parameters, connections, units, duration
    and step size; `rotordx run FILE.ssp` flies it as well. FMUs whose start values differ from those of the installed
    ones are compiled, which takes seconds the first time.

    \b
    Examples:
      rotordx export ssp avram_circle
      rotordx export ssp avram_circle --outputs --out container.ssp
      rotordx export ssp my_scenario.toml --set faults[0].rotor=3 --out rotor_3.ssp
    """
    from rotordx.orchestrator.export import ssp_export
    from rotordx.orchestrator.export.fmu_export import check_place, write
    from rotordx.orchestrator.scenario import load_scenario

    flown = load_scenario(scenario, overrides)
    path = out or Path(f"{flown.name}.ssp")
    check_place(path)
    files = ssp_export.contents(flown, outputs=outputs, report=lambda text: click.echo(text, err=True))
    write(files, path)
    fmus = sum(name.endswith(".fmu") for name in files)
    click.echo(
        f"{path}: {fmus} FMUs, {flown.duration_s:g} s at {flown.step_size_s:g} s, {path.stat().st_size / 1024:.0f} kB"
    )
