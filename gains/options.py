"""Design requests: what can be asked of a design, each option with its unit and meaning in one place."""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
import typing
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

T = TypeVar("T")


class DesignError(ValueError):
    """What was asked for cannot be designed; the message names the cause and what to change."""


def option(default: Any, unit: str, meaning: str) -> Any:
    """Field of an options dataclass, with its unit ("" if it is no quantity) and what it means."""
    return dataclasses.field(default=default, metadata={"unit": unit, "meaning": meaning})


def described(options: Any, prefix: str = "") -> Iterator[tuple[str, Any, str, str]]:
    """(name, value, unit, meaning) of every option; options of options have dotted names."""
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            yield from described(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, value, field.metadata["unit"], field.metadata["meaning"]


def from_plain(cls: type[T], values: dict[str, Any]) -> T:
    """Options from their plain form, as a design file keeps them.

    Raises:
        DesignError: if an option is unknown or of the wrong type.
    """
    options = cls()
    for name, value in values.items():
        if isinstance(value, dict):
            value = from_plain(type(_field_value(options, name)), value)
            options = dataclasses.replace(options, **{name: value})  # type: ignore[type-var]
        else:
            options = _replaced(options, name, value)
    return options


def with_settings(options: T, settings: Iterable[str]) -> T:
    """Options with settings such as `step_size=0.004` or `envelope.tilt=0.2`; values are written as in TOML.

    Raises:
        DesignError: if a setting is malformed, unknown or of the wrong type.
    """
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise DesignError(f"the setting {setting!r} is not of the form NAME=VALUE")
        try:
            parsed = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            parsed = value  # a bare word is a text
        options = _set(options, name.strip(), parsed)
    return options


def _set(options: T, name: str, value: Any) -> T:
    head, dot, rest = name.partition(".")
    if dot:
        inner = _field_value(options, head)
        if not dataclasses.is_dataclass(inner):
            raise DesignError(f"the option {head} has no parts; set it with {head}=VALUE")
        return dataclasses.replace(options, **{head: _set(inner, rest, value)})  # type: ignore[type-var]
    return _replaced(options, name, value)


def _field_value(options: Any, name: str) -> Any:
    names = [field.name for field in dataclasses.fields(options)]
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        raise DesignError(f"there is no option {name}{hint}; the options are {', '.join(names)}")
    return getattr(options, name)


def _replaced(options: T, name: str, value: Any) -> T:
    _field_value(options, name)
    hint = typing.get_type_hints(type(options))[name]
    allowed = typing.get_args(hint) if type(None) in typing.get_args(hint) else (hint,)
    for kind in allowed:
        converted = _converted(value, kind)
        if converted is not _MISFIT:
            return dataclasses.replace(options, **{name: converted})  # type: ignore[type-var]
    wanted = " or ".join(_NAMES.get(typing.get_origin(kind) or kind, "a value") for kind in allowed)
    raise DesignError(f"the option {name} must be {wanted}, not {value!r}")


_MISFIT = object()
_NAMES = {float: "a number", bool: "true or false", str: "a text", tuple: "a list of the right length", type(None): "none"}


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
