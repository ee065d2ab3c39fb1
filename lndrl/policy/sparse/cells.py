"""The linear layer over the cells of the last map, cell by cell, and its gradients.

Only rows that differ from the response to the empty map are multiplied, those of a cell together.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from lndrl.kernels import kernel
from lndrl.policy.sparse.rows import Rows
from lndrl.policy.sparse.structure import MapStructure

_RUN = 2048
"""Rows whose products are kept at a time: with 512 outputs 4 MB, which a cache may hold."""


@kernel()
def _add_rows(rows, index, out):
    """out[index[i]] += rows[i]."""
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            out[index[i], j] += rows[i, j]


def multiply_cells(rows: Rows, empty: Rows | None, weight: Rows, s: MapStructure) -> Rows:
    """Sums by sample (N + 1, F) of rows (B, C), times their cell's weights.

    weight (cells, C, F), contiguous or transposed. The last row sums the responses to the empty
    map, ``empty`` (cells, C); None leaves them out.
    """
    out = np.zeros((s.samples + 1, weight.shape[2]), np.float32)
    skip = int(empty is None)
    for run in _runs(s):
        first, last = run[0][1], run[-1][2]
        taken = _gathered(rows, empty, s, run)
        products = np.zeros((last - first, weight.shape[2]), np.float32)
        for cell, begin, end in run:
            if begin + skip < end:
                its = slice(begin + skip - first, end - first)
                np.dot(taken[its], weight[cell], out=products[its])
        _add_rows(products, s.sample[first:last], out)
    return out


def sums_by_sample(products: Rows, s: MapStructure) -> Rows:
    """Sums (N + 1, F) of products in the order of ``s.order``."""
    out = np.zeros((s.samples + 1, products.shape[1]), np.float32)
    _add_rows(products, s.sample, out)
    return out


def cell_linear(rows: Rows, weight: Rows, base: Rows, s: MapStructure) -> Rows:
    """The layer over rows (B, C): (N, F).

    weight (cells, C, F) as above; ``base`` (F,) is the layer's response to the empty map.
    """
    out = multiply_cells(rows, None, weight, s)[:-1]
    return np.add(out, base, out=out)


def gradients(
    gradient: Rows, rows: Rows, empty: Rows, weight: Rows, s: MapStructure
) -> tuple[Rows, Rows, Rows]:
    """By rows, ``empty`` and weight, of ``multiply_cells``.

    ``gradient`` (N + 1, F) is that by its result; the weights are (cells, F, C) here.
    """
    by_rows, by_empty, by_weight = (np.empty_like(each) for each in (rows, empty, weight))
    for run in _runs(s):
        first, taken = run[0][1], _gathered(rows, empty, s, run)
        for cell, begin, end in run:
            by_row = gradient.take(s.sample[begin:end], axis=0)
            found = np.dot(by_row, weight[cell])
            by_empty[cell], by_rows[s.order[begin + 1 : end]] = found[0], found[1:]
            np.dot(by_row.T, taken[begin - first : end - first], out=by_weight[cell])
    return by_rows, by_empty, by_weight


def groups(s: MapStructure) -> list[tuple[int, int]]:
    """Where in ``s.order`` each cell begins and ends."""
    return list(pairwise(s.starts.tolist()))


def _runs(s: MapStructure) -> Iterator[list[tuple[int, int, int]]]:
    """Cells with their begin and end, in runs of about ``_RUN`` rows; none is empty."""
    run: list[tuple[int, int, int]] = []
    for cell, (begin, end) in enumerate(groups(s)):
        if run and end - run[0][1] > _RUN:
            yield run
            run = []
        run.append((cell, begin, end))
    if run:
        yield run


def _gathered(
    rows: Rows, empty: Rows | None, s: MapStructure, run: list[tuple[int, int, int]]
) -> Rows:
    """Rows (B, C) in the order of ``s.order`` from the first cell of ``run`` to its last.

    Each cell begins with its empty response; without ``empty`` with anything.
    """
    order = s.order[run[0][1] : run[-1][2]]
    # Places of empty responses lie beyond the rows.
    clipped = rows.take(order, axis=0, mode="clip") if len(rows) else None
    out = np.zeros((len(order), rows.shape[1]), np.float32) if clipped is None else clipped
    if empty is not None:
        out[[begin - run[0][1] for _, begin, _ in run]] = empty[[cell for cell, _, _ in run]]
    return out


KERNELS = (_add_rows,)
"""What acting calls from Python."""
