"""Physics, ports and co-simulation components of rotordx: where they are found by name."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rotordx.fmus.shell.ports import Component

__all__ = ["component_names", "diagnoser_ids", "fmu_path", "load_component", "vehicle_names"]


def component_names() -> list[str]:
    """Names of the FMUs written in C++: folders with a `ports.py` (`shell/ports.py` is the declaration language)."""
    return sorted(f.name for f in files("rotordx.fmus").iterdir() if f.name != "shell" and (f / "ports.py").is_file())


def diagnoser_ids() -> list[str]:
    """Ids of the diagnosers: folders of `diagnosers` with a `step.py`."""
    return sorted(f.name for f in files("rotordx.fmus.diagnosers").iterdir() if (f / "step.py").is_file())


def vehicle_names() -> list[str]:
    """Names of the packaged vehicles."""
    names = (f.name for f in files("rotordx.fmus.vehicles").iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def fmu_path(name: str, fmi: int = 3) -> Path:
    """Path of a built FMU.

    Args:
        name: component name or diagnoser id.
        fmi: major version of FMI, 2 or 3.

    Raises:
        FileNotFoundError: if there is no such FMU; the message lists those that there are.
    """
    folder = Path(str(files("rotordx.fmus") / "binaries" / f"fmi{fmi}"))
    path = folder / f"{name}.fmu"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.fmu"))) or "none: build them with 'make build'"
        raise FileNotFoundError(f"there is no FMI {fmi} FMU {name!r}; built are {known}")
    return path


def load_component(name: str) -> Component:
    """Port declarations of a component or a diagnoser (a diagnoser's step is written in CasADi, which is imported).

    Raises:
        LookupError: if there is no such component.
    """
    from importlib import import_module

    if name in component_names():
        component: Component = import_module(f"rotordx.fmus.{name}.ports").COMPONENT
        return component
    if name in diagnoser_ids():
        from rotordx.fmus.diagnosers.codegen import diagnoser_component

        return diagnoser_component(name)
    raise LookupError(f"there is no component {name!r}; known are {', '.join(component_names() + diagnoser_ids())}")
