"""Convolutions of small patches as products of polynomials (Toom and Cook; Winograd's family).

A patch of h x w cells, zero around, convolved with a 3 x 3 kernel has (h + 2) x (w + 2) outputs.
Along one axis patch and kernel are polynomials of h and 3 coefficients, the output is their
product of h + 2; that is found from its values at as many points, where it is a product of
numbers. So each output costs one multiplication of (channels in, channels out) instead of 9 h w
in all: of a patch of 3 x 3 cells 25 instead of 81.

The points are those that keep float32's rounding smallest: the largest error of an output is some
3e-6 of the largest output.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

LONGEST = 4
"""Cells of the longest side of a patch. Larger ones would need points that round worse."""

SIDE = LONGEST + 2
POINTS = SIDE * SIDE
"""Of both axes; point i of the rows and j of the columns is number ``SIDE * i + j``."""

_INFINITY = None  # where a polynomial's value is its highest coefficient
_PLACES: tuple[Fraction | None, ...] = (
    Fraction(0), _INFINITY, Fraction(1), Fraction(-1), Fraction(-2), Fraction(1, 2),
)  # fmt: skip
"""A patch of h cells uses the first h + 2."""

Matrix = list[list[Fraction]]


def evaluation() -> NDArray[np.float32]:
    """float32 (LONGEST + 1, SIDE, LONGEST): of h coefficients the value at point i, [h, i]."""
    out = np.zeros((LONGEST + 1, SIDE, LONGEST), np.float32)
    for h in range(1, LONGEST + 1):
        out[h, : h + 2, :h] = _float(_values(h, h + 2))
    return out


def interpolation() -> NDArray[np.float32]:
    """float32 (LONGEST + 1, SIDE, SIDE): coefficient o of the product of h + 2 values, [h, o]."""
    out = np.zeros((LONGEST + 1, SIDE, SIDE), np.float32)
    for h in range(1, LONGEST + 1):
        out[h, : h + 2, : h + 2] = _float(_inverse(_values(h + 2, h + 2)))
    return out


def kernel_evaluation() -> NDArray[np.float32]:
    """float32 (POINTS, 9): a kernel's value at every point from its taps, row-major.

    An input counts for the output before it by the kernel's last tap: the polynomial's
    coefficients are the taps in reverse.
    """
    one = _float(_values(3, SIDE))[:, ::-1]
    return np.kron(one, one).astype(np.float32)


def _values(coefficients: int, points: int) -> Matrix:
    """Row i: what each of ``coefficients`` is multiplied with at point i."""
    highest = [Fraction(int(k == coefficients - 1)) for k in range(coefficients)]
    return [
        highest if place is None else [place**k for k in range(coefficients)]
        for place in _PLACES[:points]
    ]


def _inverse(matrix: Matrix) -> Matrix:
    """By Gauss and Jordan, exactly."""
    n = len(matrix)
    rows = [[*row, *(Fraction(int(i == j)) for j in range(n))] for i, row in enumerate(matrix)]
    for c in range(n):
        pivot = next(r for r in range(c, n) if rows[r][c])
        rows[c], rows[pivot] = rows[pivot], rows[c]
        rows[c] = [value / rows[c][c] for value in rows[c]]
        for r in range(n):
            if r != c:
                rows[r] = [a - rows[r][c] * b for a, b in zip(rows[r], rows[c], strict=True)]
    return [row[n:] for row in rows]


def _float(matrix: Matrix) -> NDArray[np.float64]:
    return np.array([[float(value) for value in row] for row in matrix])
