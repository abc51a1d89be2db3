"""Design requests: what can be asked of a design, each option with its unit and meaning in one place."""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

T = TypeVar("T")


class DesignError(ValueError):
    """What was asked for cannot be designed; the message names the cause and what to change."""


#: Smallest value of what has to be positive.
POSITIVE = 1e-9


def option(
    default: Any,
    unit: str,
    meaning: str,
    *,
    minimum: float = 0.0,
    maximum: float = math.inf,
    choices: Sequence[str] = (),
) -> Any:
    """Field of an options dataclass.

    Args:
        default: value unless asked otherwise.
        unit: SI unit, "" if it is no quantity.
        meaning: one line for the user.
        minimum, maximum: smallest and largest number, also of each element.
        choices: what a text can be.
    """
    limits = {"minimum": minimum, "maximum": maximum, "choices": tuple(choices)}
    return dataclasses.field(default=default, metadata={"unit": unit, "meaning": meaning, **limits})


def described(options: Any) -> Iterator[tuple[str, Any, str, str]]:
    """(name, value, unit, meaning) of every option."""
    for field in dataclasses.fields(options):
        yield field.name, getattr(options, field.name), field.metadata["unit"], field.metadata["meaning"]


def from_plain(cls: type[T], values: Mapping[str, Any]) -> T:
    """Options from their plain form, as a design file keeps them.

    Raises:
        DesignError: if an option is unknown, of the wrong type or out of its range.
    """
    options = cls()
    for name, value in values.items():
        options = _replaced(options, name, value)
    return options


def with_settings(options: T, settings: Iterable[str]) -> T:
    """Options with settings such as `step_size=0.004`; values are written as in TOML, texts may be bare.

    Raises:
        DesignError: if a setting is malformed, unknown, of the wrong type or out of its range.
    """
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise DesignError(f"the setting {setting!r} is not of the form NAME=VALUE")
        try:
            parsed = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            parsed = value
        options = _replaced(options, name.strip(), parsed)
    return options


def _replaced(options: Any, name: str, value: Any) -> Any:
    fields = {field.name: field for field in dataclasses.fields(options)}
    if name not in fields:
        near = difflib.get_close_matches(name, fields, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        raise DesignError(f"there is no option {name}{hint}; the options are {', '.join(fields)}")
    hinted = typing.get_type_hints(type(options))[name]
    allowed = typing.get_args(hinted) if type(None) in typing.get_args(hinted) else (hinted,)
    for kind in allowed:
        converted = _converted(value, kind)
        if converted is not _MISFIT:
            _check_range(name, converted, fields[name].metadata)
            return dataclasses.replace(options, **{name: converted})
    wanted = " or ".join(_NAMES.get(typing.get_origin(kind) or kind, "a value") for kind in allowed)
    raise DesignError(f"the option {name} must be {wanted}, not {value!r}")


def _check_range(name: str, value: Any, metadata: Mapping[str, Any]) -> None:
    if isinstance(value, str) and metadata["choices"] and value not in metadata["choices"]:
        raise DesignError(f"the option {name} must be one of {', '.join(metadata['choices'])}, not {value}")
    for element in value if isinstance(value, tuple) else (value,):
        if isinstance(element, float):
            if not math.isfinite(element):
                raise DesignError(f"the option {name} must be finite, not {element}")
            if element < metadata["minimum"]:
                wanted = "positive" if metadata["minimum"] == POSITIVE else f"at least {metadata['minimum']:g}"
                raise DesignError(f"the option {name} must be {wanted}, not {element:g}")
            if element > metadata["maximum"]:
                raise DesignError(f"the option {name} must be at most {metadata['maximum']:g}, not {element:g}")


_MISFIT = object()
_NAMES = {
    float: "a number",
    bool: "true or false",
    str: "a text",
    tuple: "a list of the right length",
    type(None): "none",
}


def _converted(value: Any, kind: Any) -> Any:
    """The value as one of `kind`, or `_MISFIT`."""
    if kind is type(None):
        return None if value in (None, "none") else _MISFIT
    if kind is float:
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else _MISFIT
    if typing.get_origin(kind) is tuple:
        kinds = typing.get_args(kind)
        if not isinstance(value, list | tuple):
            return _MISFIT
        if kinds[-1] is Ellipsis:
            kinds = (kinds[0],) * len(value)
        elements = tuple(_converted(v, k) for v, k in zip(value, kinds, strict=False))
        return elements if len(value) == len(kinds) and _MISFIT not in elements else _MISFIT
    return value if isinstance(value, kind) else _MISFIT
