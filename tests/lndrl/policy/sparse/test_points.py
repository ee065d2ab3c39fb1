"""Products of polynomials at points: exact but for rounding, for every size of a patch."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lndrl.policy.sparse.points import (
    LONGEST,
    SIDE,
    evaluation,
    interpolation,
    kernel_evaluation,
)

SIZES = [(h, w) for h in range(1, LONGEST + 1) for w in range(1, LONGEST + 1)]


def plain(patch: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """What every output in reach of a patch (h, w, C) gets by taps (3, 3, C, O)."""
    h, w, _ = patch.shape
    out = np.zeros((h + 2, w + 2, taps.shape[3]))
    padded = np.pad(patch, ((2, 2), (2, 2), (0, 0)))
    for y in range(h + 2):
        for x in range(w + 2):
            out[y, x] = np.einsum("abc,abco->o", padded[y : y + 3, x : x + 3], taps)
    return out


def at_points(
    patch: NDArray[np.float64], taps: NDArray[np.float64], kind: type[np.floating]
) -> NDArray[np.floating]:
    """The same by way of the points, all in ``kind``."""
    h, w, channels = patch.shape
    rows, columns = (evaluation()[n, : n + 2, :n].astype(kind) for n in (h, w))
    kernels = kernel_evaluation().astype(kind) @ taps.astype(kind).reshape(9, -1)
    kernels = kernels.reshape(SIDE, SIDE, channels, -1)[: h + 2, : w + 2]
    values = np.einsum("iy,jx,yxc->ijc", rows, columns, patch.astype(kind))
    products = np.einsum("ijc,ijco->ijo", values, kernels)
    back = interpolation().astype(kind)
    found: NDArray[np.floating] = np.einsum(
        "yi,xj,ijo->yxo", back[h, : h + 2, : h + 2], back[w, : w + 2, : w + 2], products
    )
    return found


@pytest.mark.parametrize(("h", "w"), SIZES)
def test_what_comes_back_is_the_convolution(h: int, w: int) -> None:
    generator = np.random.default_rng(h * 10 + w)
    patch, taps = generator.normal(size=(h, w, 5)), generator.normal(size=(3, 3, 5, 7))
    np.testing.assert_allclose(at_points(patch, taps, np.float64), plain(patch, taps), atol=2e-5)


@pytest.mark.parametrize(("h", "w"), SIZES)
def test_rounding_stays_small(h: int, w: int) -> None:
    generator = np.random.default_rng(h * 10 + w)
    worst = 0.0
    for _ in range(20):
        patch = np.maximum(generator.normal(size=(h, w, 128)), 0.0)
        taps = generator.normal(size=(3, 3, 128, 8))
        exact = plain(patch, taps)
        error = np.abs(at_points(patch, taps, np.float32) - exact).max()
        worst = max(worst, float(error / np.abs(exact).max()))
    assert worst < 8e-6


def test_a_patch_of_h_cells_uses_the_first_points() -> None:
    for h in range(1, LONGEST + 1):
        assert not evaluation()[h, h + 2 :].any() and not evaluation()[h, :, h:].any()
        assert not interpolation()[h, h + 2 :].any() and not interpolation()[h, :, h + 2 :].any()
