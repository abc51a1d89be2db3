"""From healthy flights to files: an identified vehicle, and beside it the designs of the diagnosers for it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.vehicles import Vehicle, VehicleError, load_vehicle, vehicle_names
from rotordx.gains.design import Design, write_design
from rotordx.gains.flight_identification import Trim, identify_vehicle, vehicle_file
from rotordx.gains.flights import Flight
from rotordx.gains.held_out import held_out_ratio
from rotordx.orchestrator.errors import UserError


@dataclass(frozen=True)
class Identified:
    """What was found, and the files that hold it."""

    trim: Trim
    files: list[Path]


def identify(flights: Sequence[Flight], base: Vehicle, out: Path) -> Identified:
    """Identify a vehicle and, with it, every diagnoser that is identified from flights.

    A diagnoser is if `rotordx.gains.<id>` has a function `identify(flights, vehicle, bound_factor=BOUND_FACTOR)`. Its
    bounds are widened until they hold on each flight also for the design that is identified without it.

    Args:
        flights: healthy.
        base: gives what flights do not tell.
        out: vehicle file to write; the designs go to `designs/<stem of out>/` beside it.

    Raises:
        UserError: the flights or `out` cannot be used.
    """
    if out.suffix != ".toml":
        raise UserError(f"{out}: a vehicle file ends in .toml; choose another --out")
    if any(out.resolve() == file.resolve() for file in base.files):
        raise UserError(f"{out} is the base vehicle itself; choose another --out")
    partial = out.with_name(f".{out.stem}.partial.toml")
    try:
        vehicle, trim = identify_vehicle(flights, base, out.stem)
        out.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(vehicle_file(vehicle, _reference(base, out), trim, flights), encoding="utf-8")
        load_vehicle(partial)  # refuses what cannot fly
        designs = [_design(module, flights, base, vehicle) for module in _identifiable()]
        partial.replace(out)
        return Identified(trim, [out, *(write_design(design, out.parent / "designs") for design in designs)])
    except (VehicleError, ValueError) as error:
        raise UserError(f"no vehicle can be identified: {str(error).replace(partial.name, out.name)}") from error
    except OSError as error:
        raise UserError(f"{out} cannot be written: {error.strerror}; choose another --out") from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def _identifiable() -> list[ModuleType]:
    names = [f"rotordx.gains.{diagnoser}" for diagnoser in diagnoser_ids()]
    modules = [import_module(name) for name in names if find_spec(name)]
    return [module for module in modules if hasattr(module, "identify")]


def _design(module: ModuleType, flights: Sequence[Flight], base: Vehicle, vehicle: Vehicle) -> Design:
    widening = max(1.0, held_out_ratio(module.identify, flights, base)) if len(flights) > 1 else 1.0
    design: Design = module.identify(flights, vehicle, bound_factor=round(module.BOUND_FACTOR * widening, 3))
    return design


def _reference(base: Vehicle, out: Path) -> str:
    """The base as the vehicle file names it: a packaged name, or a path relative to the file."""
    if base.name in vehicle_names() and load_vehicle(base.name).files == base.files:
        return base.name
    return Path(os.path.relpath(base.files[0], out.parent)).as_posix()
