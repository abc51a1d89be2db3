"""Certified designs: parameters of a diagnoser with the certificates that prove them, as JSON of fixed bytes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rotordx.fmus.vehicles import Vehicle
from rotordx.gains.design import plain_hash, vehicle_parameters
from rotordx.gains.flight_model import model_terms_hash
from rotordx.gains.options import DesignError
from rotordx.gains.rounding import rounded
from rotordx.gains.theory import Certificate

#: Version of the file's layout; a reader refuses any other.
SCHEMA = "rotordx design, version 1"


@dataclass(frozen=True)
class CertifiedDesign:
    """A design whose gains are computed and proved; `options` is the request, from which it can be made again."""

    diagnoser: str
    vehicle: str
    parameters: dict[str, Any]  #: FMU parameters by port name: numbers, or arrays (matrices by rows) as lists
    options: dict[str, Any]
    certificates: tuple[Certificate, ...]
    vehicle_parameters: dict[str, Any]
    vehicle_hash: str
    model_terms_hash: str
    solver: dict[str, str]


def new_design(
    diagnoser: str, vehicle: Vehicle, options: Any, parameters: dict[str, Any], certificates: Iterable[Certificate]
) -> CertifiedDesign:
    """A design with everything that it depends on: vehicle, model terms and solver as they are now."""
    own = vehicle_parameters(vehicle)
    return CertifiedDesign(
        diagnoser=diagnoser,
        vehicle=vehicle.name,
        parameters=parameters,
        options=plain(options),
        certificates=tuple(certificates),
        vehicle_parameters=own,
        vehicle_hash=plain_hash(own),
        model_terms_hash=model_terms_hash(),
        solver={name: version(name) for name in ("cvxpy", "clarabel")},
    )


def document(design: CertifiedDesign) -> dict[str, Any]:
    """The design as plain data, without its digest."""
    return {
        "schema": SCHEMA,
        "diagnoser": design.diagnoser,
        "vehicle": design.vehicle,
        "parameters": plain(design.parameters),
        "options": plain(design.options),
        "certificates": [
            {
                "name": c.name,
                "theory": c.theory.name,
                "statement": c.theory.statement,
                "model": plain(c.model),
                "proof": plain(c.proof),
                "figures": plain(_rounded_figures(c.figures)),
            }
            for c in design.certificates
        ],
        "solver": design.solver,
        "vehicle_parameters": plain(design.vehicle_parameters),
        "hashes": {"vehicle": design.vehicle_hash, "model_terms": design.model_terms_hash},
    }


def signed(design: CertifiedDesign) -> dict[str, Any]:
    """The design as plain data, with its digest last."""
    content = document(design)
    return {**content, "digest": plain_hash(content)}


def text(design: CertifiedDesign) -> str:
    """Contents of the design file; the same design gives the same bytes."""
    return _format(signed(design), "") + "\n"


def read(path: Path) -> dict[str, Any]:
    """Plain data of a design file, certified or identified from flights.

    Raises:
        DesignError: if it is neither, or of another version.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DesignError(f"{path} cannot be read ({error.strerror}); give the path of a design file") from error
    except ValueError as error:
        raise DesignError(f"{path} is not JSON ({error}); give the path of a design file") from error
    found = content.get("schema") if isinstance(content, dict) else None
    if found != SCHEMA and not (isinstance(content, dict) and "identified_from" in content):
        raise DesignError(f"{path} has the schema {found!r}, not {SCHEMA!r}; design it anew with this version")
    return content


def plain(value: Any) -> Any:
    """Dataclasses, arrays and tuples as dictionaries and lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {key: plain(v) for key, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    return value


def unplain(cls: type[Any], content: dict[str, Any]) -> Any:
    """Instance of a dataclass of names, numbers, arrays and tuples of matrices from its plain form.

    Raises:
        DesignError: if a field is missing or unknown.
    """
    names = {f.name for f in dataclasses.fields(cls)}
    if names != set(content):
        raise DesignError(f"the fields of {cls.__name__} are {sorted(names)}, the file has {sorted(content)}")
    return cls(**{name: _array(value) for name, value in content.items()})


def _array(value: Any) -> Any:
    if not isinstance(value, list):
        return float(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if value and isinstance(value[0], str):
        return tuple(value)
    if value and isinstance(value[0], list) and value[0] and isinstance(value[0][0], list):
        return tuple(np.array(matrix, dtype=float) for matrix in value)
    return np.array(value, dtype=float)


def _rounded_figures(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded_figures(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_rounded_figures(v) for v in value]
    return rounded(value, 6) if isinstance(value, float) else value


def _format(value: Any, indent: str) -> str:
    """JSON with one line for each vector and each row of a matrix."""
    deeper = indent + " "
    if isinstance(value, dict) and value:
        lines = [f"{deeper}{json.dumps(key)}: {_format(v, deeper)}" for key, v in value.items()]
        return "{\n" + ",\n".join(lines) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(v, list | dict) for v in value):
        return "[\n" + ",\n".join(deeper + _format(v, deeper) for v in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False)
