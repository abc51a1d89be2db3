"""Units of foreign FMUs: what they measure, and how their values become SI values.

A unit is known by the base units that the FMU declares for it, or else by its name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rotordx.fmus.shell.model_description import base_unit

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")

#: units outside the SI, and multiples, that stand in products: SI unit, factor
_MULTIPLES = {
    "deg": ("rad", math.pi / 180),
    "rev": ("rad", 2 * math.pi),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "mm": ("m", 1e-3),
    "cm": ("m", 1e-2),
    "km": ("m", 1e3),
    "ft": ("m", 0.3048),
    "kN": ("N", 1e3),
    "mN": ("N", 1e-3),
    "mA": ("A", 1e-3),
    "mV": ("V", 1e-3),
}
#: those that stand alone: SI unit, factor, offset
_ALONE = {
    "rpm": ("rad/s", math.pi / 30, 0.0),
    "kn": ("m/s", 1852 / 3600, 0.0),
    "degC": ("K", 1.0, 273.15),
    "%": ("1", 0.01, 0.0),
}


@dataclass(frozen=True)
class Unit:
    """SI value = factor * value + offset."""

    exponents: Mapping[str, int] = field(default_factory=dict)  #: of the SI base units and rad
    factor: float = 1.0
    offset: float = 0.0

    @property
    def name_in_si(self) -> str:
        """The SI unit that values are converted to, for example "m/s2"."""
        above, below = (
            ".".join(f"{name}{abs(n) if abs(n) > 1 else ''}" for name, n in self.exponents.items() if n * sign > 0)
            for sign in (1, -1)
        )
        return (above or "1") + (f"/({below})" if "." in below else f"/{below}" if below else "")


def unit_of_name(name: str) -> Unit | None:
    """The unit of a name such as "deg/s", None if it is not known."""
    si, factor, offset = _ALONE.get(name, (name, 1.0, 0.0))
    for sign, product in zip((1, -1), si.split("/"), strict=False):
        for symbol, exponent in re.findall(r"([A-Za-z]+)(\d*)", product):
            factor *= _MULTIPLES.get(symbol, ("", 1.0))[1] ** (sign * int(exponent or 1))
    try:
        exponents = base_unit(re.sub(r"[A-Za-z]+", lambda match: _MULTIPLES.get(match[0], (match[0],))[0], si))
    except ValueError:
        return None
    return None if exponents is None else Unit(exponents, factor, offset)


def declared_units(description: Any) -> dict[str, Unit | None]:
    """Units of an FMU by name; None: its base units are not declared, and its name tells nothing.

    Args:
        description: fmpy.model_description.ModelDescription.
    """
    units: dict[str, Unit | None] = {}
    for unit in description.unitDefinitions:
        base = unit.baseUnit
        if base is None:
            units[unit.name] = unit_of_name(unit.name)
        else:
            exponents = {name: int(getattr(base, name)) for name in BASE_UNITS if int(getattr(base, name))}
            units[unit.name] = Unit(exponents, float(base.factor), float(base.offset))
    return units
