"""Exact proofs: right where floating point cannot tell, and the same decomposition as by hand."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from rotordx.gains.exact import exactly, is_positive_definite, pivots


def by_hand(matrix):
    """Diagonal of D of L D L^T by Gaussian elimination in fractions."""
    rows = [[Fraction(v) for v in row] for row in matrix]
    for k in range(len(rows)):
        for i in range(k + 1, len(rows)):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [rows[k][k] for k in range(len(rows))]


def test_pivots_are_those_of_gaussian_elimination():
    rng = np.random.default_rng(1)
    for n in (1, 2, 5, 9):
        root = rng.normal(size=(n, n)) * 10.0 ** rng.integers(-6, 6, (n, 1))
        matrix = root @ root.T
        matrix = (matrix + matrix.T) / 2
        found = list(pivots(exactly(matrix)))
        assert found == by_hand(matrix)[: len(found)]
        assert len(found) == n


def test_a_matrix_is_told_from_its_neighbour_beyond_floating_point():
    # [1, x; x, x^2] is singular, and so is not positive definite; with the last bit more in a corner it is
    x = Fraction(1, 3) + Fraction(1, 2**80)
    singular = np.array([[Fraction(1), x], [x, x * x]], dtype=object)
    assert not is_positive_definite(singular)
    singular[1, 1] += Fraction(1, 2**300)
    assert is_positive_definite(singular)
    assert np.linalg.eigvalsh(singular.astype(float))[0] <= 1e-16


def test_agrees_with_eigenvalues_where_these_are_clear():
    rng = np.random.default_rng(2)
    for _ in range(50):
        matrix = rng.normal(size=(6, 6))
        matrix = matrix + matrix.T + 4 * np.eye(6)
        smallest = np.linalg.eigvalsh(matrix)[0]
        assert abs(smallest) > 1e-9
        assert is_positive_definite(exactly(matrix)) == (smallest > 0)


def test_the_decomposition_ends_at_a_pivot_that_is_not_positive():
    assert list(pivots(np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]]))) == [1, 0]
    assert list(pivots(np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1]]))) == [1, -3]


def test_an_asymmetric_matrix_is_refused():
    with pytest.raises(ValueError, match="symmetric"):
        is_positive_definite(np.array([[1.0, 0.5], [0.25, 1.0]]))


def test_floats_become_the_rationals_that_they_are_everywhere():
    @dataclasses.dataclass(frozen=True)
    class Inner:
        value: float
        count: int
        name: str
        arrays: tuple

    exact = exactly(Inner(0.1, 3, "x", (np.array([[0.1, 2.0]]),)))
    assert exact.value == Fraction(0.1) != Fraction(1, 10)
    assert (exact.count, exact.name) == (3, "x")
    assert exact.arrays[0][0, 0] == Fraction(0.1)
    assert (exact.arrays[0] @ exact.arrays[0].T)[0, 0] == Fraction(0.1) ** 2 + 4
