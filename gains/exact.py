"""Proofs about stored numbers: a float is a rational number, so what is computed from it here is exact."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray


def exactly(value: Any) -> Any:
    """The same value in rational arithmetic: floats become fractions, also inside arrays, tuples and dataclasses.

    Integers stay as they are, an array of floats becomes an array of objects (`Fraction`). Sums, products and
    quotients of what is returned are exact; mixed with a float they are not, so convert everything.
    """
    if isinstance(value, float):
        return Fraction(value)
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.array([Fraction(float(v)) for v in value.flat], dtype=object).reshape(value.shape)
    if isinstance(value, tuple | list):
        return type(value)(exactly(v) for v in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.replace(
            value, **{f.name: exactly(getattr(value, f.name)) for f in dataclasses.fields(value)}
        )
    return value


def pivots(matrix: NDArray[Any]) -> Iterator[Fraction]:
    """Diagonal of D in matrix = L D L^T, exactly, up to the first element that is not positive.

    The elimination is free of fractions (Bareiss): integers, each division leaves no remainder, and their size grows
    linearly with the order instead of doubling at every step.

    Args:
        matrix: symmetric (n, n), elements `Fraction` or int (floats are taken as the rationals that they are).

    Raises:
        ValueError: if the matrix is not symmetric.
    """
    rows = [[Fraction(v) for v in row] for row in matrix]
    if any(rows[i][j] != rows[j][i] for i in range(len(rows)) for j in range(i)):
        raise ValueError("an LDL^T decomposition needs a symmetric matrix")
    scale = lcm(*(v.denominator for row in rows for v in row))
    integers = [[v.numerator * (scale // v.denominator) for v in row] for row in rows]
    previous = 1
    for k, row in enumerate(integers):
        minor = row[k]
        yield Fraction(minor, previous * scale)
        if minor <= 0:
            return
        for i in range(k + 1, len(integers)):
            factor = integers[i][k]
            for j in range(k + 1, i + 1):
                integers[i][j] = (integers[i][j] * minor - factor * integers[j][k]) // previous
        previous = minor


def is_positive_definite(matrix: NDArray[Any]) -> bool:
    """Whether a symmetric matrix is positive definite; a proof, not an estimate."""
    return all(pivot > 0 for pivot in pivots(matrix))
