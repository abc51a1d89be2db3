"""What is packaged, by name and in one line each."""

from __future__ import annotations

import ast
from importlib.resources import files

from rotordx.fmus import component_names, diagnoser_ids, fmu_path, load_component, vehicle_names
from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator.documents import locate, read
from rotordx.orchestrator.scenario import scenario_names


def everything() -> dict[str, dict[str, str]]:
    """Kind -> name -> description."""
    return {
        "scenarios": {name: str(read(locate(name, "scenarios"))["description"]) for name in scenario_names()},
        "vehicles": {name: load_vehicle(name).description for name in vehicle_names()},
        "diagnosers": {name: _headline(name) for name in diagnoser_ids()},
        "other FMUs": {name: load_component(name).description for name in component_names()},
        "files of the FMUs": {f"FMI {fmi}": str(fmu_path("plant", fmi).parent) for fmi in (2, 3)},
    }


def _headline(diagnoser: str) -> str:
    """First line of the docstring of a diagnoser's step, read without importing CasADi."""
    source = (files("rotordx.fmus.diagnosers") / diagnoser / "step.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
