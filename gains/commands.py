"""The commands `design` and `verify`; what they need is imported when they run, so that --help is quick."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from time import perf_counter
from types import ModuleType
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rotordx.gains.certificate import CertifiedDesign
    from rotordx.gains.design import Design


class _Mistake(click.ClickException):
    """Something that cannot be done as asked."""

    exit_code = 2


def _plainly(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what a design or a vehicle file refuses, a proof that fails, or a folder, into a sentence."""

    @wraps(command)
    def wrapped(**arguments: Any) -> None:
        from rotordx.fmus.vehicles import VehicleError
        from rotordx.gains.options import DesignError
        from rotordx.gains.verify import NotProved

        try:
            command(**arguments)
        except (DesignError, VehicleError) as error:
            raise _Mistake(str(error)) from error
        except NotProved as error:
            raise click.ClickException(str(error)) from error
        except OSError as error:
            text = f"{error.filename} cannot be written ({error.strerror}); choose another folder with --out"
            raise _Mistake(text) from error

    return wrapped


@click.command("design", short_help="Design a diagnoser's gains, with a certificate.")
@click.argument("diagnoser", metavar="ID")
@click.option("--vehicle", default="lab_x", metavar="V", help="Name of a packaged vehicle, or path of a vehicle file.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("designs"), metavar="DIR", help="Folder [designs]."
)
@click.option("--speed", type=float, metavar="S", help="Faster (above 1) or quieter (below 1).")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="Change an option; repeatable.")
@click.option("--explain", "explained", is_flag=True, help="Say what is solved, and draw noise against speed.")
@_plainly
def design_command(
    diagnoser: str, vehicle: str, out: Path, speed: float | None, settings: tuple[str, ...], explained: bool
) -> None:
    """Design the parameters of diagnoser ID and write DIR/VEHICLE/ID.json, if the certificate holds.

    In the folder `designs` beside a vehicle file, designs are used whenever the vehicle is flown.

    \b
    Examples:
      rotordx design hinf --vehicle lab_x
      rotordx design hinf --vehicle my_vehicle.toml --speed 2 --explain
      rotordx design asmto --set step_size=0.004 --set tilt=0.5
    """
    if identify := _identifier(diagnoser):
        if speed is not None or settings or explained:
            raise _Mistake(f"{diagnoser} is identified from healthy flights: there is nothing to set or to explain")
        _identify(identify, vehicle, out)
    else:
        _design(diagnoser, vehicle, out, settings if speed is None else (f"speed={speed}", *settings), explained)


@click.command("verify", short_help="Prove a design's certificate again.")
@click.argument("certificates", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="CERTIFICATE...")
@_plainly
def verify_command(certificates: tuple[Path, ...]) -> None:
    """Rebuild every inequality and margin of each CERTIFICATE (a design file) from its gains and prove it again.

    \b
    Examples:
      rotordx verify designs/lab_x/hinf.json
    """
    from rotordx.gains.verify import verify

    refused = []
    for path in certificates:
        checks = verify(path)
        click.echo(f"{path}")
        width = max(len(check.what) for check in checks)
        for check in checks:
            mark = click.style("ok", fg="green") if check.passed else click.style("REFUSED", fg="red")
            click.echo(f"  {check.what:{width}}  {mark}  {check.detail}".rstrip())
        if not all(check.passed for check in checks):
            refused.append(path)
    if refused:
        raise click.ClickException(f"refused: {', '.join(map(str, refused))}")


def _design(diagnoser: str, vehicle: str, out: Path, settings: tuple[str, ...], explained: bool) -> None:
    """Design, prove, write, and say what was done."""
    from rotordx.fmus.vehicles import load_vehicle
    from rotordx.gains import explain
    from rotordx.gains.options import with_settings
    from rotordx.gains.verify import write_proved

    module, craft = designer(diagnoser), load_vehicle(vehicle)
    options = with_settings(module.Options(), settings)
    start = perf_counter()
    design = module.design(craft, options)
    path = write_proved(design, out)
    _show(design)
    click.echo(f"{path} (designed and proved in {perf_counter() - start:.1f} s)")
    if explained:
        for line in explain.explanation(module, craft, options, design):
            click.echo(line)
        points = explain.trade_off(module, craft, options, design)
        click.echo("\n  speed   settling time   noise of the estimates")
        for point in points:
            click.echo(f"  {point.speed:5g}   {point.settling_time:11.3f} s   {point.noise_std:.4g}")
        if points:
            drawing = path.with_suffix(".svg")
            drawing.write_text(explain.figure(points, f"{diagnoser} for {craft.name}"), encoding="utf-8")
            click.echo(f"{drawing}")


def _identify(identify: Callable[[str], Design], vehicle: str, out: Path) -> None:
    """Fly, identify, write, and say what was done."""
    from rotordx.gains.design import write_design

    start = perf_counter()
    path = write_design(identify(vehicle), out)
    click.echo(f"{path} (identified from healthy simulated flights in {perf_counter() - start:.1f} s)")


def _identifier(diagnoser: str) -> Callable[[str], Design] | None:
    """Function that flies a vehicle and identifies a diagnoser's design, if a higher floor has one."""
    found = entry_points(group="rotordx.designers", name=diagnoser)
    return next(iter(found)).load() if found else None


def designer(diagnoser: str) -> ModuleType:
    """Module of `rotordx.gains` that designs a diagnoser.

    Raises:
        DesignError: if there is none.
    """
    from rotordx.gains.options import DesignError

    name = f"rotordx.gains.{diagnoser}"
    if diagnoser.isidentifier() and find_spec(name) and hasattr(import_module(name), "subjects"):
        return import_module(name)
    raise DesignError(f"there is nothing to design for {diagnoser}; choose among {', '.join(designable())}")


def designable() -> list[str]:
    """Diagnosers with certified gains: the modules of this package that say what their certificates are about."""
    import rotordx.gains

    names = [module.name for module in iter_modules(rotordx.gains.__path__)]
    return [name for name in names if hasattr(import_module(f"rotordx.gains.{name}"), "subjects")]


def _show(design: CertifiedDesign) -> None:
    """The certificates' figures, one line each."""
    for certificate in design.certificates:
        click.echo(f"{certificate.name}")
        for name, value in _figures(certificate.proof, certificate.figures):
            click.echo(f"  {name:28} {value}")


def _figures(proof: Any, figures: dict[str, Any]) -> Iterable[tuple[str, str]]:
    for name in ("gamma", "gamma_optimum"):
        if hasattr(proof, name):
            yield name, f"{getattr(proof, name):.5g}"
    for name, value in figures.items():
        if isinstance(value, dict):
            yield name, ", ".join(f"{key} {_number(v)}" for key, v in value.items())
        elif isinstance(value, list):
            yield name, ", ".join(map(_number, value))
        else:
            yield name, _number(value)


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "over 5" if value is None else str(value)
