"""The linear layer over the cells of the last map, cell by cell, and its gradients.

Only rows that differ from the response to the empty map are multiplied, those of a cell together.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lndrl.kernels import kernel
from lndrl.policy.sparse.rows import Rows
from lndrl.policy.sparse.structure import MapStructure


@kernel()
def _add_rows(rows, index, out):
    """out[index[i]] += rows[i]."""
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            out[index[i], j] += rows[i, j]


def grouped(rows: Rows, empty: Rows, s: MapStructure) -> Rows:
    """Rows (B, C) and those of the empty map (cells, C) in the order of ``s.order``."""
    return np.concatenate((rows, empty)).take(s.order, axis=0)


def multiply_cells(in_order: Rows, weight: Rows, s: MapStructure, skip: int) -> Rows:
    """Sums by sample (N + 1, F) of rows in the order of ``s.order``, times their cell's weights.

    weight (cells, C, F), contiguous or transposed. The last row sums the empty responses. The first
    ``skip`` rows of each cell are left out.
    """
    products = np.zeros((len(in_order), weight.shape[2]), np.float32)
    for cell, (begin, end) in enumerate(groups(s)):
        if begin + skip < end:
            rows = slice(begin + skip, end)
            np.dot(in_order[rows], weight[cell], out=products[rows])
    return sums_by_sample(products, s)


def sums_by_sample(products: Rows, s: MapStructure) -> Rows:
    """Sums (N + 1, F) of products in the order of ``s.order``."""
    out = np.zeros((s.samples + 1, products.shape[1]), np.float32)
    _add_rows(products, s.sample, out)
    return out


def cell_linear(rows: Rows, weight: Rows, base: Rows, s: MapStructure) -> Rows:
    """The layer over rows (B, C): (N, F).

    weight (cells, C, F) as above; ``base`` (F,) is the layer's response to the empty map.
    """
    absent = np.zeros((len(s.cell_stand_in), rows.shape[1]), np.float32)
    out = multiply_cells(grouped(rows, absent, s), weight, s, 1)[:-1]
    return np.add(out, base, out=out)


def gradients(gradient: Rows, in_order: Rows, weight: Rows, s: MapStructure) -> tuple[Rows, Rows]:
    """By rows in the order of ``s.order`` and by weight, of ``multiply_cells`` without a skip.

    ``gradient`` (N + 1, F) is that by its result; the weights are (cells, F, C) here.
    """
    by_row = gradient.take(s.sample, axis=0)
    by_weight, by_rows = np.empty_like(weight), np.empty_like(in_order)
    for cell, (begin, end) in enumerate(groups(s)):
        part = slice(begin, end)
        np.dot(by_row[part], weight[cell], out=by_rows[part])
        np.dot(by_row[part].T, in_order[part], out=by_weight[cell])
    return by_rows, by_weight


def groups(s: MapStructure) -> list[tuple[int, int]]:
    """Where in ``s.order`` each cell begins and ends."""
    return list(pairwise(s.starts.tolist()))


KERNELS = (_add_rows,)
"""What acting calls from Python."""
