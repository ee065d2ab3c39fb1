"""A kernel is what it says, whoever has it compiled first."""

from __future__ import annotations

import math

import numpy as np

from lndrl.kernels import kernel


@kernel()
def _plain(x, n):
    """Allocates, divides, and adds up in an order that fast sums would change."""
    parts = np.empty(n)
    total = 0.0
    for k in range(n):
        parts[k] = 1.0 / (x + k)
        total += parts[k]
    return total


@kernel(_nrt=False, error_model="numpy", fastmath=True, forceinline=True)
def _hasty(x, n):
    return _plain(x, n)


def test_a_kernel_takes_over_nothing_from_who_compiles_it_first() -> None:
    # Of numba's own functions ``_plain`` would be refused here: no room may be taken in ``_hasty``.
    values = np.random.default_rng(0).uniform(0.1, 5.0, 50)
    first = [_hasty(x, 1000) for x in values]
    slow = [0.0] * len(values)
    for i, x in enumerate(values):
        for k in range(1000):
            slow[i] += 1.0 / (x + k)
    assert first == slow  # to the last bit: in the order in which it is written


def test_a_kernel_divides_by_zero_as_numpy_does() -> None:
    assert _plain(0.0, 1) == math.inf
