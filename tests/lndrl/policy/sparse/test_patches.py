"""How what differs is cut: every row in one patch, patches small, outputs where they belong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lndrl.policy.sparse import MapStructure, drawn_structure
from lndrl.policy.sparse.patches import Patches
from lndrl.policy.sparse.points import LONGEST, POINTS, SIDE
from lndrl.policy.sparse.structure import STAND_IN


def structure_of(marks: NDArray[np.bool_], pooling: int) -> MapStructure:
    maps = np.zeros((len(marks), 3, *marks.shape[1:]), np.float32)
    maps[:, 0] = marks
    return drawn_structure(maps, pooling)


def cuts(marks: NDArray[np.bool_], pooling: int) -> list[tuple[Patches, int, int]]:
    """Patches of the second and the third convolution, their rows and their map's side."""
    found = structure_of(marks, pooling)
    sides = [marks.shape[1] // pooling**i for i in (1, 2)]
    rows = [len(level.stand_in) for level in found.levels[:-1]]
    return [
        (level.patches, count, side)
        for level, count, side in zip(found.levels[1:], rows, sides, strict=True)
        if level.patches is not None
    ]


@pytest.mark.parametrize("pooling", [1, 2])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.0, 0.01, 0.05, 0.5, 1.0]))
def test_every_row_lies_in_one_patch(pooling: int, seed: int, share: float) -> None:
    marks = np.random.default_rng(seed).random((3, STAND_IN[2], STAND_IN[2])) < share
    found = cuts(marks, pooling)
    assert len(found) == 2
    for cut, rows, _ in found:
        inside = cut.rows[cut.rows >= 0]
        np.testing.assert_array_equal(np.sort(inside), np.arange(rows))
        assert (cut.sizes >= 1).all() and (cut.sizes <= LONGEST).all()
        assert cut.ends[-1] == len(cut.sizes)
        at = np.arange(LONGEST**2)
        beyond = (at // LONGEST >= cut.sizes[:, :1]) | (at % LONGEST >= cut.sizes[:, 1:])
        assert (cut.rows[beyond] == -1).all()
        # Nothing is multiplied for the sake of an empty border.
        grid = (cut.rows >= 0).reshape(-1, LONGEST, LONGEST)
        for patch, (h, w) in zip(grid, cut.sizes, strict=True):
            assert patch[0].any() and patch[h - 1].any()
            assert patch[:, 0].any() and patch[:, w - 1].any()


@pytest.mark.parametrize("pooling", [1, 2])
def test_places_are_those_of_the_points_in_order(pooling: int) -> None:
    marks = np.random.default_rng(4).random((3, STAND_IN[2], STAND_IN[2])) < 0.1
    for cut, _, _ in cuts(marks, pooling):
        used = cut.places[cut.places >= 0]
        np.testing.assert_array_equal(np.sort(used), np.arange(cut.starts[-1]))
        for point in range(POINTS):
            has = (cut.sizes[:, 0] + 2 > point // SIDE) & (cut.sizes[:, 1] + 2 > point % SIDE)
            expected = cut.starts[point] + np.arange(has.sum())
            np.testing.assert_array_equal(cut.places[has, point], expected)
            assert (cut.places[~has, point] == -1).all()


def test_targets_lie_around_the_patch() -> None:
    """Of one block's difference: nine outputs, in the blocks that hold them."""
    marks = np.zeros((1, 24, 24), bool)
    marks[0, 10, 10] = True
    found = structure_of(marks, 2)
    cut = found.levels[1].patches
    assert cut is not None and len(cut.sizes) == 1
    h, w = cut.sizes[0]
    targets = cut.targets[0].reshape(SIDE, SIDE)[: h + 2, : w + 2]
    assert (targets >= 0).all() and len(np.unique(targets)) == targets.size
    # Neighbours along a row of a block are outputs s and s + 1, below each other s and s + 2.
    slots = targets % 4
    assert (slots[:, 1:] % 2 != slots[:, :-1] % 2).all()
    assert (slots[1:] // 2 != slots[:-1] // 2).all()


def test_at_the_border_nothing_lies_outside() -> None:
    marks = np.zeros((1, 24, 24), bool)
    marks[0, 0, 0] = True
    cut = structure_of(marks, 2).levels[1].patches
    assert cut is not None
    targets = cut.targets[0].reshape(SIDE, SIDE)
    assert (targets[0] == -1).all() and (targets[:, 0] == -1).all()
    assert targets[1, 1] >= 0


def test_the_same_map_is_cut_alike_whoever_comes_first() -> None:
    """People are listed in any order; sums must not depend on it."""
    marks = np.zeros((2, 24, 24), bool)
    marks[:, 3:7, 3:7] = True
    marks[:, 14:17, 12:18] = True
    for cut, _, _ in cuts(marks, 2):
        first, second = np.split(cut.sizes, [int(cut.ends[0])])
        np.testing.assert_array_equal(first, second)
