"""Numbers that can be read and repeated: rounding below the accuracy of solvers, before anything is proved.

A solver's last digits depend on the processor. What a certificate stores is therefore rounded first and proved
afterwards; inequalities are solved with enough room for it.
"""

from __future__ import annotations

from math import floor, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rounded(value: Any, digits: int = 12) -> Any:
    """A float, or an array relative to its largest element, to so many significant digits."""
    if isinstance(value, np.ndarray):
        return _to_multiples(value, np.full(value.shape, np.abs(value).max(initial=0.0)), digits)
    return float(f"{value:.{digits - 1}e}")


def rounded_rows(matrix: Array, digits: int = 6) -> Array:
    """A gain in closed form, each row relative to its largest element."""
    return _to_multiples(matrix, np.broadcast_to(np.abs(matrix).max(axis=1, keepdims=True), matrix.shape), digits)


def rounded_gain(gain: Array, P: Array, C: Array, rate: float, digits: int = 5) -> Array:
    """An observer gain L, each element relative to what changes the dynamics by `rate` (1/s) in the norm of e^T P e.

    Elements that are the solver's noise around zero become zero.
    """
    sizes = rate / np.sqrt(np.outer(np.diag(P), np.diag(C @ np.linalg.solve(P, C.T))))
    return _to_multiples(gain, sizes, digits)


def rounded_form(matrix: Array, digits: int = 7) -> Array:
    """A positive definite matrix, each element relative to the root of its two diagonal elements; symmetric."""
    diagonal = np.sqrt(np.diag(matrix))
    return _to_multiples((matrix + matrix.T) / 2, np.outer(diagonal, diagonal), digits)


def rounded_down(value: float, digits: int = 5) -> float:
    """A positive float, towards zero, to so many significant digits."""
    exponent = digits - 1 - floor(log10(value))
    return round(floor(value * 10.0**exponent) / 10.0**exponent, exponent)


def _to_multiples(values: Array, sizes: Array, digits: int) -> Array:
    """Each value to the decimal place that makes `digits` significant digits of its size."""
    result = np.zeros(values.shape)
    for index, value in np.ndenumerate(values):
        if sizes[index] > 0:
            result[index] = round(float(value), digits - 1 - floor(log10(sizes[index]))) + 0.0  # no negative zeros
    return result
