"""TOML documents, packaged or the user's own: found, read, changed and validated, each mistake told in one sentence."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from rotordx.orchestrator.errors import UserError


class Section(BaseModel):
    """Base of every table of a document; the description of a field says in words what its value must be."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


SectionT = TypeVar("SectionT", bound=Section)


def packaged_names(folder: str) -> list[str]:
    """Names of the packaged documents of a folder, "scenarios" or "systems"."""
    return sorted(path.stem for path in _folder(folder).glob("*.toml"))


def locate(name_or_path: str, folder: str) -> Path:
    """Path of a document given by its packaged name or its path.

    Raises:
        UserError: it is neither.
    """
    if name_or_path.endswith(".toml"):
        return Path(name_or_path)
    names = packaged_names(folder)
    if name_or_path not in names:
        raise UserError(f"{name_or_path!r} must be {one_of(names, name_or_path)}, or the path of a .toml file")
    return _folder(folder) / f"{name_or_path}.toml"


def read(path: Path) -> dict[str, Any]:
    """The document; paths of FMUs, vehicles and systems in it are relative to it and are returned relative to here.

    Raises:
        UserError: it cannot be read or is not TOML.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise UserError(f"{path} is not valid TOML: {error}") from error
    components = document.get("components")
    for table in [document, *(components.values() if isinstance(components, dict) else ())]:
        for key in ("fmu", "vehicle", "system"):
            value = table.get(key) if isinstance(table, dict) else None
            if isinstance(value, str) and value.endswith((".fmu", ".toml")):
                table[key] = str(path.parent / value)
    return document


def override(document: dict[str, Any], assignment: str) -> None:
    """Change one element of a document in place.

    Args:
        document: plain data; tables on the way to the element are made if need be, list elements are not.
        assignment: PATH=VALUE such as "faults[0].rotor=3"; VALUE is TOML, or a text without quotes.

    Raises:
        UserError: there is no such element and it cannot be made.
    """
    path, separator, text = assignment.partition("=")
    keys = path.strip().replace("[", ".[").split(".")
    if not separator or not all(keys):
        raise UserError(f"--set {assignment}: write PATH=VALUE, for example faults[0].rotor=3")
    node: Any = document
    for position, key in enumerate(keys):
        where = ".".join(keys[:position]).replace(".[", "[")
        if key.startswith("[") and isinstance(node, list):
            elements = {f"[{i}]": i for i in range(len(node))}
            if key not in elements:
                raise UserError(f"--set {assignment}: {where} has {len(node)} elements, counted from 0")
            place: int | str = elements[key]
        elif key.startswith("[") and node == {}:
            example = "faults=[{rotor = 3, onset_s = 24.0, loss_of_effectiveness = 0.2}]"
            raise UserError(f"--set {assignment}: there is no list {where}; give it whole, for example {example}")
        elif key.startswith("[") or not isinstance(node, dict):
            raise UserError(f"--set {assignment}: {where} is no {'list' if key.startswith('[') else 'table'}")
        else:
            place = key
            node.setdefault(place, {})
        if position == len(keys) - 1:
            node[place] = _value(text.strip())
        else:
            node = node[place]


def validated(model: type[SectionT], document: Mapping[str, Any], source: str) -> SectionT:
    """The document as a model.

    Raises:
        UserError: it is not one; one sentence for each mistake, on a line of its own that begins with `source`.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise UserError("\n".join(f"{source}: {sentence}" for sentence in _sentences(model, error))) from error


def one_of(known: Iterable[str], given: str) -> str:
    """What may stand in place of a wrong name: "one of a, b, c (did you mean b?)", without listing very many."""
    known = list(known)
    matches = difflib.get_close_matches(given, known, n=1)
    names = ", ".join(known) if len(known) <= 10 or not matches else f"{len(known)} names"
    return f"one of {names or 'none'}" + (f" (did you mean {matches[0]}?)" if matches else "")


def _folder(name: str) -> Path:
    return Path(str(resources.files("rotordx.orchestrator") / name))


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _sentences(model: type[Section], error: ValidationError) -> Iterator[str]:
    for problem in error.errors():
        location = problem["loc"]
        path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).removeprefix(".")
        field, section = _resolve(model, location)
        allowed = (field.description if field else None) or "a table"
        if problem["type"] == "extra_forbidden":
            yield f"{path} is not a known field, it must be {one_of(_fields(section), str(location[-1]))}"
        elif problem["type"] == "missing":
            yield f"{path} is missing, it must be {allowed}"
        elif problem["type"] == "value_error":
            yield ": ".join(filter(None, (path, str(problem["ctx"]["error"]))))
        else:
            yield f"{path} is {_shown(problem['input'])} but must be {allowed}"


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    return f"a list of {len(value)}" if isinstance(value, list) and len(value) > 6 else repr(value)


def _fields(section: type[BaseModel]) -> dict[str, FieldInfo]:
    return {info.alias or name: info for name, info in section.model_fields.items()}


def _resolve(model: type[Section], location: tuple[int | str, ...]) -> tuple[FieldInfo | None, type[BaseModel]]:
    """The innermost field on the way to a location, and the section in which the location's last part lies."""
    field: FieldInfo | None = None
    section: type[BaseModel] = model
    inner: type[BaseModel] = model
    for part in location:
        section = inner
        if part in _fields(inner):
            field = _fields(inner)[str(part)]
            inner = _section_within(field.annotation) or inner
    return field, section


def _section_within(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_section_within, get_args(annotation))), None)
