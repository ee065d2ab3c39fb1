"""Pairs of boxes at a distance, wherever there are points that far apart."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.maps.grid import distance_field
from lndrl.maps.pairs import far_nodes, pair_boxes, wide_parts
from lndrl.maps.paths import Roadmap
from lndrl.maps.raycast import sample_field
from lndrl.maps.regions import Box, centre, grow_box

STEP = 0.05
ROOM = 0.27


def roadmap_of(occupied: np.ndarray) -> Roadmap:
    return Roadmap.build(distance_field(occupied, STEP), STEP, ROOM, 0.7)


@pytest.fixture(scope="module")
def floors() -> Roadmap:
    """A hall of 12 x 9 m, and apart from it a corridor of 20 x 1 m."""
    occupied = np.ones((220, 420), bool)
    occupied[4:184, 4:244] = False
    occupied[190:210, 4:404] = False
    return roadmap_of(occupied)


def middle_distance(start: Box, goal: Box) -> float:
    return float(np.hypot(*(centre(goal) - centre(start))))


def test_each_seed_gets_a_partner_at_the_distance(floors) -> None:
    seeds = floors.nearest(np.array([[2.0, 2.0], [10.0, 2.0], [2.0, 7.0], [10.0, 7.0]]))
    pairs = pair_boxes(floors, seeds, (5.0, 7.0), ROOM, 2.0, 12)
    assert len(pairs) == 4
    for pair in pairs:
        assert 5.0 <= middle_distance(pair.start, pair.goal) <= 7.0
        assert 1.0 <= pair.detour <= 1.1
        for box in (pair.start, pair.goal):
            assert 1.0 <= box[2] - box[0] <= 2.0 and 1.0 <= box[3] - box[1] <= 2.0
            corners = [(x, y) for x in box[::2] for y in box[1::2]]
            room = [sample_field(floors.distance, 1 / STEP, *c) - STEP / 2 for c in corners]
            assert min(room) >= ROOM - 1e-6
    assert pairs == pair_boxes(floors, seeds, (5.0, 7.0), ROOM, 2.0, 12)
    assert len(pair_boxes(floors, seeds, (5.0, 7.0), ROOM, 2.0, 2)) == 2  # enough is enough
    middles = np.array([centre(box) for pair in pairs for box in (pair.start, pair.goal)])
    gaps = np.hypot(*(middles[:, None] - middles[None]).transpose(2, 0, 1))
    assert gaps[np.triu_indices(8, 1)].min() > 0.5  # not all towards one place


def test_no_pair_joins_two_floors(floors) -> None:
    seeds, reach = far_nodes(floors, 1)
    assert reach == pytest.approx(19.5, abs=0.3)
    pairs = pair_boxes(floors, seeds, (11.0, 13.0), ROOM, 2.0, 12)
    assert pairs
    for pair in pairs:
        assert min(pair.start[1], pair.goal[1]) > 9.5
        assert pair.start[3] - pair.start[1] < 0.6 <= 1.5 < pair.start[2] - pair.start[0]


def test_parts_are_told_by_how_far_they_reach(floors) -> None:
    assert far_nodes(floors, 0)[1] == pytest.approx(np.hypot(11.4, 8.4), abs=0.3)
    assert wide_parts(floors, 1.0) == [0, 1]
    assert wide_parts(floors, 17.0) == [1]
    assert wide_parts(floors, 30.0) == []


def test_only_the_outermost_points_are_as_far_apart_as_the_floor_is_long() -> None:
    occupied = np.ones((30, 260), bool)
    occupied[4:26, 4:-4] = False  # 12.6 x 1.1 m; the robot's centre moves along 12.1 m
    roadmap = roadmap_of(occupied)
    ends, reach = far_nodes(roadmap, 0)
    assert 11.8 < reach < 12.2
    assert not pair_boxes(roadmap, ends, (reach - 0.02, reach + 0.02), ROOM, 2.0, 12)
    (pair, *_) = pair_boxes(roadmap, ends, (reach - 0.02, reach + 0.02), ROOM, 0.0, 12)
    assert pair.start[:2] == pair.start[2:] and pair.goal[:2] == pair.goal[2:]
    assert not pair_boxes(roadmap, ends, (reach + 0.5, reach + 2.0), ROOM, 0.0, 12)


@pytest.mark.parametrize("step", [0.05, 0.03, 0.037])
def test_a_box_in_a_slit_keeps_its_room(step) -> None:
    occupied = np.ones((40, 200), bool)
    wide = 2 * round(ROOM / step) + 2
    occupied[10 : 10 + wide, 5:-5] = False
    field = distance_field(occupied, step)
    row = 10 + wide // 2
    for side in (0.0, 2.0):
        seed = np.array([100.5, row + 0.5]) * step
        if field[row, 100] < ROOM + 0.5 * step:
            continue
        box = grow_box(field, step, seed, ROOM, side)
        at = centre(box)
        assert sample_field(field, 1 / step, *at) - step / 2 >= ROOM - 1e-6
        assert side > 0.0 or box[:2] == box[2:]
