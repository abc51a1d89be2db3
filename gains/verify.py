"""Checks of design files: every claim is rebuilt from the stored gains and proved again, in two arithmetics."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle, VehicleError, load_vehicle, vehicle_names
from rotordx.gains.certificate import CertifiedDesign, plain, read, signed, text, unplain
from rotordx.gains.design import design_file, plain_hash, vehicle_hash, vehicle_parameters, write_whole
from rotordx.gains.exact import exactly, is_positive_definite
from rotordx.gains.flight_model import model_terms_hash
from rotordx.gains.options import DesignError, from_plain
from rotordx.gains.theory import Subject

#: Relative agreement of stored figures (six digits) with figures computed anew.
FIGURE_TOLERANCE = 5e-6

#: Relative agreement of stored margins and settling times (four digits, three) with those of the gains.
MARGIN_TOLERANCE = 1e-3

#: Agreement of stored models (twelve digits) with models made anew, relative to the largest element of each matrix.
MODEL_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Check:
    """One line of a verification; `detail` is a margin if it passed, else the reason."""

    what: str
    passed: bool
    detail: str = ""


class NotProved(Exception):
    """A design whose certificate fails; the message names the claim and the reason."""


def write_proved(design: CertifiedDesign, folder: Path) -> Path:
    """Write a design to `<folder>/<vehicle>/<diagnoser>.json` if its certificate holds.

    Raises:
        NotProved: if it does not.
        OSError: if the file cannot be written.
    """
    path = design_file(folder, design.vehicle, design.diagnoser)
    for check in checks(signed(design), path):
        if not check.passed:
            raise NotProved(f"{path} is not written, its certificate fails: {check.what}: {check.detail}")
    return write_whole(path, text(design))


def verify(path: Path) -> list[Check]:
    """All checks of a design file.

    Raises:
        DesignError: if it is not a design file.
    """
    document = read(path)
    return list(checks(document, path) if "certificates" in document else _identified_checks(document, path))


def _identified_checks(document: dict[str, Any], path: Path) -> Iterator[Check]:
    """Of a design that was identified from flights: there is nothing to prove, but the vehicle must be the same."""
    vehicle = _vehicle_of(str(document.get("vehicle")), path)
    if vehicle is None:
        yield Check("vehicle", False, "no vehicle file at hand to compare with")
    else:
        agrees = document["identified_from"].get("vehicle_sha256") == vehicle_hash(vehicle)
        remedy = "it changed since the identification; identify it anew"
        yield _check("vehicle", agrees, remedy, "identified from flights")


def checks(document: dict[str, Any], path: Path) -> Iterator[Check]:
    """Checks of the plain data of a design that lies, or will lie, at a path.

    Raises:
        DesignError: if something that a design consists of is missing or malformed.
    """
    try:
        yield from _file_checks(document, path)
        module = importlib.import_module(f"rotordx.gains.{document['diagnoser']}")
        options = from_plain(module.Options, document["options"])
        parameters = {k: tuple(v) if isinstance(v, list) else v for k, v in document["vehicle_parameters"].items()}
        vehicle = Vehicle(document["vehicle"], "", parameters)
        subjects = module.subjects(vehicle, options, document["parameters"])
        claims = {claim["name"]: claim for claim in document["certificates"]}
        yield _check("names", set(claims) == set(subjects), f"expected certificates for {', '.join(subjects)}")
        for name in [name for name in subjects if name in claims]:
            for check in _certificate_checks(claims[name], subjects[name]):
                yield dataclasses.replace(check, what=f"{name}: {check.what}")
        yield _margin_check(module.decision_parameters, vehicle, options, document["parameters"])
    except DesignError:
        raise
    except (AttributeError, ImportError, IndexError, KeyError, TypeError, ValueError) as error:
        raise DesignError(f"{path} is not a complete design file: {error}; design it anew") from error


def _check(what: str, passed: bool, reason: str, detail: str = "") -> Check:
    return Check(what, bool(passed), detail if passed else reason)


def _file_checks(document: dict[str, Any], path: Path) -> Iterator[Check]:
    """Is the file as it was written, for the vehicle and the model terms as they are now?"""
    content = {key: value for key, value in document.items() if key != "digest"}
    yield _check("digest", plain_hash(content) == document["digest"], "the file was changed after it was written")
    stored, hashes = document["vehicle_parameters"], document["hashes"]
    yield _check("vehicle hash", plain_hash(stored) == hashes["vehicle"], "it does not belong to the stored parameters")
    vehicle = _vehicle_of(document["vehicle"], path)
    if vehicle is None:
        yield Check("vehicle", True, "no vehicle file at hand: checked for the parameters in the design")
    else:
        current = plain(vehicle_parameters(vehicle))
        changed = sorted(name for name in current.keys() | stored.keys() if current.get(name) != stored.get(name))
        yield _check("vehicle", not changed, f"{', '.join(changed)} changed since the design; design it anew")
    terms = hashes["model_terms"] == model_terms_hash()
    yield _check("model terms", terms, "they changed since the design was made; design it anew")


def _vehicle_of(name: str, path: Path) -> Vehicle | None:
    """The vehicle whose folder of designs the file lies in, else the packaged one of that name, else None."""
    own = path.resolve().parent.parent.parent / f"{name}.toml"
    try:
        return load_vehicle(own) if own.is_file() else load_vehicle(name) if name in vehicle_names() else None
    except VehicleError as error:
        raise DesignError(str(error)) from error


def _certificate_checks(claim: dict[str, Any], subject: Subject) -> Iterator[Check]:
    theory, gain = subject.theory, subject.gain
    model, proof = unplain(theory.model, claim["model"]), unplain(theory.proof, claim["proof"])
    different = sorted(differences(plain(model), plain(subject.model), MODEL_TOLERANCE))
    yield _check("model", not different, f"{', '.join(different)} differ from what follows from the vehicle")
    exact = theory.inequalities(*exactly((model, gain, proof)))
    for name, matrix in theory.inequalities(model, gain, proof).items():
        margin = _smallest_eigenvalue(matrix)
        yield _check(name, margin > 0, f"violated: smallest eigenvalue {margin:.2e}", f"margin {margin:.1e}")
        if margin > 0:
            yield _check(f"{name}, exact", is_positive_definite(exact[name]), "violated in rational arithmetic")
    try:
        figures = plain(theory.figures(model, gain, proof))
    except np.linalg.LinAlgError as error:
        yield Check("figures", False, f"cannot be computed: {error}")
        return
    different = sorted(differences(claim["figures"], figures, FIGURE_TOLERANCE))
    yield _check("figures", not different, f"{', '.join(different)} do not follow from the gains")
    for name, (value, limit) in theory.limits(proof, figures).items():
        yield _check(name, value <= limit, f"{value:.6g} exceeds {limit:.6g}", f"{value:.6g} <= {limit:.6g}")


def _margin_check(
    decision_parameters: Callable[[Vehicle, Any, dict[str, Any]], dict[str, Any]],
    vehicle: Vehicle,
    options: Any,
    parameters: dict[str, Any],
) -> Check:
    """Are the margins those of a healthy vehicle with these gains? An unstable observer, refused already, has none."""
    with np.errstate(all="ignore"):
        found = plain(decision_parameters(vehicle, options, parameters))
    stored = {name: parameters.get(name) for name in found}
    different = ", ".join(sorted(differences(stored, found, MARGIN_TOLERANCE)))
    return _check("margins", not different, f"{different} not what follows from the gains", ", ".join(found))


def _smallest_eigenvalue(matrix: NDArray[np.float64]) -> float:
    """Of the matrix scaled to a unit diagonal, so that no element is negligible; negative if that cannot be done."""
    diagonal = np.diag(matrix)
    if diagonal.min() <= 0:
        return float(min(diagonal.min(), -1e-300))
    return float(np.linalg.eigvalsh(matrix / np.sqrt(np.outer(diagonal, diagonal)))[0])


def differences(first: Any, second: Any, tolerance: float, name: str = "") -> Iterator[str]:
    """Dotted names of what differs between two trees of plain data; numbers relative to the largest of their array."""
    if isinstance(first, dict) and isinstance(second, dict):
        for key in first.keys() | second.keys():
            yield from differences(first.get(key), second.get(key), tolerance, f"{name}.{key}".lstrip("."))
    elif _dictionaries(first) and _dictionaries(second) and len(first) == len(second):
        for i, pair in enumerate(zip(first, second, strict=True)):
            yield from differences(*pair, tolerance, f"{name}[{i}]")
    elif not _agree(first, second, tolerance):
        yield name


def _dictionaries(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(v, dict) for v in value)


def _agree(first: Any, second: Any, tolerance: float) -> bool:
    """Texts, numbers or nested lists of them: equal, or within a tolerance relative to the largest element."""
    if first == second:
        return True
    try:
        a, b = np.array(first, dtype=float), np.array(second, dtype=float)
    except (TypeError, ValueError):
        return False
    if a.shape != b.shape:
        return False
    size = max(np.abs(a).max(initial=0.0), np.abs(b).max(initial=0.0))
    return bool(np.all(np.abs(a - b) <= tolerance * size))  # which it is not with a NaN
