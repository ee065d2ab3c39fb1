"""The rasteriser against a slow twin, its axes, and the sparse list of the same cells."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import TaskConfig
from lndrl.navigation.pedestrian_map import draw_pedestrian_map, pedestrian_cells

TASK = TaskConfig()


def slow_map(people: np.ndarray, count: int, task: TaskConfig) -> np.ndarray:
    """Every cell asks every person, the last one wins."""
    cells, half = task.map_cells, 0.5 * task.map_extent
    size = task.map_extent / cells
    centre = half - (np.arange(cells) + 0.5) * size
    ahead, left = np.meshgrid(centre, centre, indexing="ij")
    out = np.zeros((3, cells, cells), np.float32)
    for x, y, vx, vy in people[:count].astype(np.float64):
        if abs(x) > half or abs(y) > half:
            continue
        disc = (ahead - x) ** 2 + (left - y) ** 2 <= task.pedestrian_radius**2
        out[0][disc], out[1][disc], out[2][disc] = 1.0, vx, vy
    return out


def random_people(seed: int, samples: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    people = rng.uniform(-spread, spread, (samples, 24, 4)).astype(np.float32)
    return people, rng.integers(0, 25, samples).astype(np.uint8)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), spread=st.sampled_from([0.5, 3.0, 4.0]))
def test_matches_slow_twin(seed: int, spread: float) -> None:
    people, count = random_people(seed, 4, spread)
    drawn = draw_pedestrian_map(people, count, TASK)
    for n in range(4):
        np.testing.assert_array_equal(drawn[n], slow_map(people[n], int(count[n]), TASK))


def test_matches_slow_twin_for_other_sizes() -> None:
    task = TaskConfig(map_cells=31, map_extent=5.0, pedestrian_radius=0.55)
    people, count = random_people(3, 6, 2.6)
    drawn = draw_pedestrian_map(people, count, task)
    for n in range(6):
        np.testing.assert_array_equal(drawn[n], slow_map(people[n], int(count[n]), task))


def test_cells_list_the_same_map() -> None:
    people, count = random_people(1, 30, 3.2)
    drawn = draw_pedestrian_map(people, count, TASK).reshape(30, 3, -1)
    offsets, cell, velocity = pedestrian_cells(people, count, TASK)
    rebuilt = np.zeros_like(drawn)
    for n in range(30):
        rows = slice(offsets[n], offsets[n + 1])
        assert len(np.unique(cell[rows])) == offsets[n + 1] - offsets[n]
        rebuilt[n, 0, cell[rows]] = 1.0
        rebuilt[n, 1:, cell[rows]] = velocity[rows]
    np.testing.assert_array_equal(rebuilt, drawn)
    assert offsets[-1] == len(cell) == (drawn[:, 0] == 1.0).sum()


def test_no_people_no_cells() -> None:
    people, count = np.zeros((3, 24, 4), np.float32), np.zeros(3, np.uint8)
    offsets, cell, velocity = pedestrian_cells(people, count, TASK)
    assert offsets.tolist() == [0, 0, 0, 0]
    assert cell.shape == (0,) and velocity.shape == (0, 2)
    assert not draw_pedestrian_map(people, count, TASK).any()


def test_ahead_is_up_and_left_is_left() -> None:
    people = np.zeros((2, 24, 4), np.float32)
    people[0, 0] = [2.9, 0.0, 0.3, -0.4]
    people[1, 0] = [0.0, 2.9, 0.0, 0.0]
    drawn = draw_pedestrian_map(people, np.array([1, 1], np.uint8), TASK)
    rows, columns = np.nonzero(drawn[0, 0])
    assert rows.max() < 6 and abs(columns.mean() - 23.5) < 1e-9
    assert np.unique(drawn[0, 1]).tolist() == [0.0, np.float32(0.3)]
    assert np.unique(drawn[0, 2]).tolist() == [np.float32(-0.4), 0.0]
    rows, columns = np.nonzero(drawn[1, 0])
    assert columns.max() < 6 and abs(rows.mean() - 23.5) < 1e-9


def test_farther_overwrites_nearer() -> None:
    people = np.zeros((1, 24, 4), np.float32)
    people[0, :2] = [[1.0, 0.0, 0.1, 0.1], [1.2, 0.0, 0.2, 0.2]]
    drawn = draw_pedestrian_map(people, np.array([2], np.uint8), TASK)[0]
    alone = draw_pedestrian_map(people[:, 1:], np.array([1], np.uint8), TASK)[0]
    np.testing.assert_array_equal(drawn[1][alone[0] == 1], alone[1][alone[0] == 1])
    assert (drawn[1] == np.float32(0.1)).any()


def test_any_leading_shape_and_reused_output() -> None:
    people, count = random_people(2, 6, 3.0)
    flat = draw_pedestrian_map(people, count, TASK)
    out = np.full((2, 3, 3, 48, 48), 7.0, np.float32)
    shaped = draw_pedestrian_map(people.reshape(2, 3, 24, 4), count.reshape(2, 3), TASK, out=out)
    assert shaped is out
    np.testing.assert_array_equal(shaped.reshape(flat.shape), flat)
    one = draw_pedestrian_map(people[0], count[0], TASK)
    np.testing.assert_array_equal(one, flat[0])
    with pytest.raises(ValueError, match="contiguous"):
        draw_pedestrian_map(people, count, TASK, out=np.empty((12, 3, 48, 48), np.float32)[::2])
