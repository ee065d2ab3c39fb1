"""How what differs is cut: every row in one patch, patches small, outputs where they belong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lndrl.policy.sparse import MapStructure, drawn_structure, patches
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
@pytest.mark.parametrize("most", [1, 100, 10**6])
def test_places_are_those_of_the_points_in_order(
    pooling: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patches, "_GROUP", most)
    marks = np.random.default_rng(4).random((3, STAND_IN[2], STAND_IN[2])) < 0.1
    for cut, _, _ in cuts(marks, pooling):
        used = cut.places[cut.places >= 0]
        np.testing.assert_array_equal(np.sort(used), np.arange(cut.starts[-1, -1]))
        assert len(cut.group_ends) == len(cut.starts) and (len(cut.starts) > 1) == (most < 10**6)
        first = 0
        for end, starts in zip(cut.ends[cut.group_ends - 1], cut.starts, strict=True):
            sizes, places = cut.sizes[first:end], cut.places[first:end]
            for point in range(POINTS):
                has = (sizes[:, 0] + 2 > point // SIDE) & (sizes[:, 1] + 2 > point % SIDE)
                expected = starts[point] + np.arange(has.sum())
                np.testing.assert_array_equal(places[has, point], expected)
                assert (places[~has, point] == -1).all()
            first = end


@pytest.mark.parametrize("most", [1, 100, 10**6])
def test_groups_are_whole_samples_and_all_of_them(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where samples without anybody begin, end and part the others."""
    monkeypatch.setattr(patches, "_GROUP", most)
    marks = np.random.default_rng(5).random((9, STAND_IN[2], STAND_IN[2])) < 0.02
    marks[[0, 3, 4, 8]] = False
    for cut, _, _ in cuts(marks, 2):
        groups = list(cut.groups(4))
        assert (len(groups) == 1) == (most == 10**6)
        assert sum(len(group.sizes) for group in groups) == len(cut.sizes)
        assert sum(len(group.ends) for group in groups) == len(marks)
        patch, block = 0, 0
        for group in groups:
            mine = slice(patch, patch + len(group.sizes))
            targets = group.targets + 4 * block
            np.testing.assert_array_equal(
                targets[group.targets >= 0], cut.targets[mine][cut.targets[mine] >= 0]
            )
            assert ((group.targets >= 0) == (cut.targets[mine] >= 0)).all()
            assert group.targets.max(initial=-1) < 4 * group.block_ends[-1]
            assert group.ends[-1] == len(group.sizes)
            assert group.blocks == slice(block, block + int(group.block_ends[-1]))
            assert group.starts[-1] == (group.sizes + 2).prod(axis=1).sum() <= cut.most
            patch, block = mine.stop, group.blocks.stop
        assert block == cut.block_ends[-1]


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
