"""The folder that `rotordx export c` writes: the diagnoser's C, its example, self-test, build files and manifest."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from importlib.metadata import distribution, version
from importlib.resources import files
from pathlib import Path
from typing import Any

from rotordx.fmus.diagnosers.codegen import diagnoser_function
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.shell.ports import size
from rotordx.fmus.shell.readme import port_table
from rotordx.fmus.vehicles.parameters import SensorParameters
from rotordx.gains.design import plain_hash, vehicle_hash
from rotordx.gains.flight_model import model_terms_hash
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export import c_source, subject, wrappers
from rotordx.orchestrator.export.subject import Subject
from rotordx.orchestrator.export.templates import filled
from rotordx.orchestrator.folders import check_folder, whole_folder

MANIFEST, BUILT = "manifest.json", "build"
SCHEMA = "rotordx C export, version 1"
TARGETS = {"double": "Cortex-M7, double", "single": "Cortex-M7, single"}


def contents(exported: Subject, chosen: Iterable[str] = ()) -> dict[str, str]:
    """Files of an export: path in its folder -> text; `chosen` are the names of wrappers.

    Raises:
        UserError: a wrapper does not fit the vehicle.
    """
    values = _values(exported)
    diagnoser = exported.diagnoser
    written = {
        f"rotordx_{diagnoser}.h": c_source.header(exported),
        f"rotordx_{diagnoser}.c": c_source.source(exported),
    }
    for file in ("flight.h", "main.c", "self_test.c", "Makefile", "CMakeLists.txt"):
        written[file] = filled(f"{file}.in", **values)
    wrapped = wrappers.contents(exported, chosen, values)
    rows = "".join(f"| `{name}/` | {wrappers.WRAPPERS[name]}, not run on hardware |\n" for name in chosen)
    written["README.md"] = filled("README.md.in", **values, wrapper_rows=rows, figures=_figures_text(diagnoser))
    written["LICENSE"] = distribution("rotordx").read_text("licenses/LICENSE") or ""
    written |= wrapped
    written[MANIFEST] = json.dumps(_manifest(exported, written), indent=2, allow_nan=False) + "\n"
    return written


def check_place(folder: Path) -> None:
    """Find out before the work whether an export could be put there.

    Raises:
        UserError: the folder holds other things than an export as it was written.
    """
    earlier = _earlier(folder)
    check_folder(folder, [*{Path(name).parts[0] for name in earlier}, BUILT] if earlier else [])
    for name, digest in earlier.items():
        path = folder / name
        if name != MANIFEST and (not path.is_file() or _hash(path.read_bytes()) != digest):
            raise UserError(
                f"{path} was changed since it was exported; copy what you want to keep, then delete {folder} or "
                "choose another folder with --out"
            )


def write(exported: Mapping[str, str], folder: Path) -> None:
    """Write an export, whole or not at all, over an earlier one if there is one.

    Raises:
        UserError: see `check_place`, or the folder cannot be written.
    """
    check_place(folder)
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    with whole_folder(folder, names) as partial:
        for name, text in exported.items():
            path = partial / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


def measured(diagnoser: str) -> dict[str, dict[str, int]] | None:
    """Code size, stack (bytes) and instructions of a step by target; None if it has changed since it was measured."""
    path = files("rotordx.orchestrator.export") / "figures.json"
    figures = json.loads(path.read_text(encoding="utf-8")).get(diagnoser) if path.is_file() else None
    return figures["targets"] if figures and figures["source_sha256"] == c_source.source_hash(diagnoser) else None


def _earlier(folder: Path) -> dict[str, str]:
    """Files of an earlier export and their hashes, none if there is none."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    known = isinstance(manifest, dict) and manifest.get("schema") == SCHEMA
    return {**manifest["files"], MANIFEST: ""} if known else {}


def _manifest(exported: Subject, written: Mapping[str, str]) -> dict[str, Any]:
    """What the export rests on and consists of."""
    design = exported.design or {}
    return {
        "schema": SCHEMA,
        "rotordx": version("rotordx"),
        "diagnoser": exported.diagnoser,
        "vehicle": {"name": exported.vehicle.name, "sha256": vehicle_hash(exported.vehicle)},
        "design": {
            "certified": "certificates" in design,
            "digest": design.get("digest") or plain_hash(design),
        }
        if exported.design
        else None,
        "model_terms_sha256": model_terms_hash(),
        "source_sha256": c_source.source_hash(exported.diagnoser),
        "step_size_s": exported.step_size,
        "casadi_instructions": diagnoser_function(exported.diagnoser).n_instructions(),
        # and the counter of samples, aligned like the numbers
        "state_bytes": {name: b * (exported.state_numbers + 1) for name, b in _REAL_BYTES.items()},
        "measured": measured(exported.diagnoser),
        "files": {name: _hash(text.encode()) for name, text in written.items()},
    }


_REAL_BYTES = {"double": 8, "single": 4}


def _values(exported: Subject) -> dict[str, object]:
    """What fills the gaps of the templates."""
    flight = exported.flight
    bandwidth = exported.vehicle.fill(SensorParameters).velocity_filter_bandwidth
    return {
        "id": exported.diagnoser,
        "ID": exported.diagnoser.upper(),
        "description": exported.component.description,
        "vehicle": exported.vehicle.name,
        "parameters": c_source.constant_name(exported),
        "version": version("rotordx"),
        "step_size": f"{exported.step_size:.9g}",
        "step_ms": f"{1e3 * exported.step_size:.9g}",
        "rate": f"{1 / exported.step_size:.6g}",
        "bandwidth": f"{bandwidth:g}",
        "lag_ms": f"{2e3 / bandwidth:.0f}",
        "rotor": subject.ROTOR,
        "loss": f"{subject.LOSS:.0%}".replace("%", " %"),
        "onset": f"{subject.ONSET:g}",
        "inputs": size(Inputs),
        "outputs": size(exported.component.outputs),
        "steps": flight.steps,
        "row_steps": subject.ROW_STEPS,
        "rows": "".join(f"    {{{c_source.numbers(row, 5)}}},\n" for row in flight.rows),
        "answers": "".join(
            f"    {{{step},\n     {{{c_source.numbers(answer, 6)}}}}},\n" for step, answer in flight.answers.items()
        ),
        "ports": port_table(exported.component),
    }


def _figures_text(diagnoser: str) -> str:
    """What was measured, as a table; nothing if nothing holds for the present source."""
    figures = measured(diagnoser)
    if not figures:
        return ""
    lines = ["| | code | stack | instructions a step |", "|---|---|---|---|"]
    for target, title in TARGETS.items():
        f = figures[target]
        lines.append(f"| {title} | {f['code_bytes']} B | {f['stack_bytes']} B | {f['instructions']} |")
    return "\n".join([*lines, "\nWithout the functions of the mathematical library; instructions with them.\n"])


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
