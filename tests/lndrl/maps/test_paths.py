"""Ways through a map keep off walls and are nearly as short as can be."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lndrl.maps import paths
from lndrl.maps.grid import distance_field
from lndrl.maps.paths import Roadmap, leg_keeps, leg_room, path_length, simplify_path
from lndrl.maps.raycast import sample_field
from lndrl.maps.regions import grow_box, spread_boxes

STEP = 0.05


@pytest.fixture(scope="module")
def two_rooms() -> np.ndarray:
    """12 x 6 m, a wall at x = 6 with a door of 1 m at y 4 to 5, and a closed cell at the right."""
    occupied = np.zeros((120, 240), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[:, 118:122] = True
    occupied[80:100, 118:122] = False
    occupied[:40, 200] = occupied[40, 200:] = True
    return occupied


@pytest.fixture(scope="module")
def roadmap(two_rooms) -> Roadmap:
    return Roadmap.build(distance_field(two_rooms, STEP), STEP, 0.3, 0.7)


def room_along(roadmap: Roadmap, path: np.ndarray) -> float:
    return min(
        sample_field(roadmap.distance, 1 / STEP, *(a + u * (b - a))) - STEP / 2
        for a, b in pairwise(path)
        for u in np.linspace(0, 1, 200)
    )


def test_a_path_leads_through_the_door_and_keeps_off_the_walls(roadmap) -> None:
    start, goal = roadmap.nearest(np.array([[1.0, 1.0], [9.0, 1.0]]))
    cost, before = roadmap.search(np.array([start]))
    path = roadmap.trace(before[0], int(goal))
    assert np.isfinite(cost[0, goal])
    assert (path[0] == roadmap.nodes[start]).all() and (path[-1] == roadmap.nodes[goal]).all()
    assert room_along(roadmap, path) >= 0.3 - STEP
    few = roadmap.simplify(path, 0.5)
    assert 3 <= len(few) <= 6
    assert room_along(roadmap, few) >= 0.3 - STEP
    straight = np.hypot(5.0, 3.5) + np.hypot(3.0, 3.5)
    assert straight * 0.95 <= path_length(few) <= straight * 1.1
    door = path[np.argmin(abs(path[:, 0] - 6.0))]
    assert 4.3 <= door[1] <= 4.7


def test_what_is_walled_off_is_another_part(roadmap) -> None:
    left, right, cell = roadmap.nearest(np.array([[1.0, 1.0], [9.0, 3.0], [11.0, 1.0]]))
    assert roadmap.part[left] == roadmap.part[right] == 0 != roadmap.part[cell]
    cost, before = roadmap.search(np.array([left]))
    assert np.isinf(cost[0, cell])
    assert len(roadmap.trace(before[0], int(cell))) == 1


def test_room_of_a_leg_is_that_of_its_worst_point(roadmap) -> None:
    rng = np.random.default_rng(1)
    for a, b in rng.uniform((0.2, 0.2), (9.8, 5.8), (100, 2, 2)):
        slow = min(
            sample_field(roadmap.distance, 1 / STEP, *(a + u * (b - a)))
            for u in np.linspace(0, 1, 2000)
        )
        fast = leg_room(roadmap.distance, 1 / STEP, *a, *b)
        assert fast == pytest.approx(slow - STEP / 2, abs=0.8 * STEP)
        assert roadmap.sees(a, b, 0.3) == (fast >= 0.3)


def test_a_leg_keeps_the_room_that_its_worst_point_has(roadmap: Roadmap) -> None:
    rng = np.random.default_rng(2)
    for a, b in rng.uniform((0.2, 0.2), (9.8, 5.8), (200, 2, 2)):
        worst = leg_room(roadmap.distance, 1 / STEP, *a, *b)
        for room in (worst, np.nextafter(worst, 9.0), 0.3):
            assert leg_keeps(roadmap.distance, 1 / STEP, *a, *b, room) == (worst >= room)


def test_a_leg_is_given_up_at_its_first_wall(
    roadmap: Roadmap, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Long ways among many walls try thousands of legs; most end right away."""
    looked: list[float] = []

    def sample(distance: np.ndarray, scale: float, x: float, y: float) -> float:
        looked.append(x)
        return float(sample_field(distance, scale, x, y))

    monkeypatch.setattr(paths, "sample_field", sample)
    leg = (5.5, 2.0, 11.5, 2.0)  # the wall is at 6
    assert not leg_keeps.py_func(roadmap.distance, 1 / STEP, *leg, 0.3)
    assert 3 <= len(looked) <= 8 and max(looked) < 6.0


def test_a_straight_way_needs_its_ends_only(roadmap) -> None:
    path = np.stack([np.linspace(1, 5, 30), np.full(30, 3.0)], axis=1)
    kept = simplify_path(path, np.full(30, 1.0), roadmap.distance, 1 / STEP, 0.5)
    assert kept.tolist() == [0, 29]


def test_boxes_are_free_connected_and_spread(roadmap, two_rooms) -> None:
    boxes = spread_boxes(roadmap, 0.3, 8, 2.0)
    assert len(boxes) == 8
    for x0, y0, x1, y1 in boxes:
        assert 0.5 <= x1 - x0 <= 2.0 and 0.5 <= y1 - y0 <= 2.0
        for x in np.linspace(x0, x1, 9):
            for y in np.linspace(y0, y1, 9):
                assert sample_field(roadmap.distance, 1 / STEP, x, y) - STEP / 2 >= 0.3 - 1e-6
    middles = np.array([((b[0] + b[2]) / 2, (b[1] + b[3]) / 2) for b in boxes])
    gaps = np.hypot(*(middles[:, None] - middles[None]).transpose(2, 0, 1))
    assert gaps[np.triu_indices(8, 1)].min() > 1.0
    assert (middles[:, 0] < 6).any() and (middles[:, 0] > 6).any()
    assert not ((middles[:, 0] > 10) & (middles[:, 1] < 2)).any()  # the closed cell
    assert boxes == spread_boxes(roadmap, 0.3, 8, 2.0)


def test_a_box_in_a_passage_is_long_and_narrow() -> None:
    occupied = np.ones((60, 200), bool)
    occupied[20:40, 5:-5] = False  # 1 m wide
    field = distance_field(occupied, STEP)
    x0, y0, x1, y1 = grow_box(field, STEP, np.array([5.0, 1.5]), 0.2, 2.0)
    assert x1 - x0 > 1.7 and 0.4 <= y1 - y0 <= 0.6
    assert spread_boxes(Roadmap.build(field, STEP, 0.45, 0.7), 0.45, 5, 2.0) == []
