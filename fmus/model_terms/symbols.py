"""CasADi symbols for port classes."""

from __future__ import annotations

from typing import TypeVar

from casadi import SX

from rotordx.fmus.shell import ports

T = TypeVar("T")


def symbols(cls: type[T], name: str = "") -> tuple[SX, T]:
    """One column of symbols for all ports of a class, and the instance whose ports are slices of it.

    Args:
        cls: class decorated with `ports`.
        name: name of the symbols, by default that of the class.
    """
    vector = SX.sym(name or cls.__name__, ports.size(cls))
    return vector, ports.unflatten(cls, vector)
