"""The command `rotordx`: its subcommands are found by entry points, so that every package brings its own."""

from __future__ import annotations

import difflib
from importlib.metadata import entry_points

import click

from rotordx.orchestrator import interruption
from rotordx.orchestrator.errors import RunError, UserError

GROUP = "rotordx.commands"


class UserFailure(click.ClickException):
    """Ends the process with the exit code of user errors; plain click exceptions do with that of failed runs, 1."""

    exit_code = 2


class Commands(click.Group):
    """Subcommands from the entry points of `GROUP`; an error of theirs becomes a sentence and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in alphabetical order."""
        return sorted(entry_points(group=GROUP).names)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        found = entry_points(group=GROUP, name=cmd_name)
        command: click.Command | None = next(iter(found)).load() if found else None
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command to run, or suggest the one that was probably meant."""
        nearest = difflib.get_close_matches(args[0], self.list_commands(ctx), n=1)
        if nearest and self.get_command(ctx, args[0]) is None:
            ctx.fail(f"there is no command {args[0]}, did you mean {nearest[0]}?")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Run a command: exit code 2 for an error of the user's, 1 for a run that failed or was interrupted."""
        try:
            with interruption.remembered():
                return super().invoke(ctx)
        except UserError as error:
            raise UserFailure(str(error)) from error
        except RunError as error:
            raise click.ClickException(str(error)) from error
        except KeyboardInterrupt as error:
            raise click.ClickException("interrupted, no result was written") from error


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rotordx", message="%(version)s")
def main() -> None:
    """Fault diagnosis for multirotor actuators: fly, break a rotor, diagnose it.

    \b
    Example:
      rotordx run avram_circle --set faults[0].rotor=3
    """
