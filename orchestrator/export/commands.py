"""The command `export`; what it needs is imported when it runs, so that --help is quick."""

from __future__ import annotations

import click

from rotordx.orchestrator.export.c_commands import c_command
from rotordx.orchestrator.export.fmu_commands import fmu_command, ssp_command


@click.group("export", short_help="Take a diagnoser into other tools.")
def export_command() -> None:
    """Take what was designed and validated here into other tools."""


export_command.add_command(c_command)
export_command.add_command(fmu_command)
export_command.add_command(ssp_command)
