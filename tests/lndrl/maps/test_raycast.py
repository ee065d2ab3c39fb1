import numpy as np
import pytest

from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.raycast import raycast, sample_field

RESOLUTION = 0.1


def slow_range(occupied, x, y, angle, range_max, step=RESOLUTION / 200):
    t = np.arange(0.0, range_max, step)
    columns = np.floor((x + t * np.cos(angle)) / RESOLUTION).astype(int)
    rows = np.floor((y + t * np.sin(angle)) / RESOLUTION).astype(int)
    inside = (rows >= 0) & (columns >= 0)
    inside &= (rows < occupied.shape[0]) & (columns < occupied.shape[1])
    hit = np.zeros(len(t), dtype=bool)
    hit[inside] = occupied[rows[inside], columns[inside]]
    left = np.flatnonzero(~inside)
    if left.size:
        hit[left[0] :] = False
    return t[np.argmax(hit)] if hit.any() else range_max


@pytest.mark.parametrize("density", [0.003, 0.03])
def test_ranges_match_tiny_steps(density):
    rng = np.random.default_rng(7)
    occupied = rng.random((60, 80)) < density
    grid = OccupancyGrid(occupied, RESOLUTION)
    field = distance_field(occupied, RESOLUTION)
    errors = []
    for _ in range(40):
        x, y = rng.uniform(0, 8), rng.uniform(0, 6)
        bearings = rng.uniform(-np.pi, np.pi, 12)
        got = raycast(grid, field, np.array([x, y, 0.3]), bearings, 5.0)
        slow = [slow_range(occupied, x, y, 0.3 + b, 5.0) for b in bearings]
        errors.extend(np.abs(got - slow))
    apart = np.array(errors)
    # Tiny steps may jump over the very corner of a cell; everything else agrees to a step.
    assert (apart < 0.01 * RESOLUTION).mean() > 0.97
    assert np.median(apart) <= RESOLUTION / 200


def test_axis_parallel_rays_end_at_the_face_of_the_cell():
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[:, 30] = True
    occupied[0] = True
    grid = OccupancyGrid(occupied, RESOLUTION)
    field = distance_field(occupied, RESOLUTION)
    for y in (0.5, 1.0, 2.03):  # on a cell border as well
        bearings = np.array([0.0, -np.pi / 2, np.pi])
        ranges = raycast(grid, field, np.array([1.0, y, 0.0]), bearings, 12.0)
        assert ranges == pytest.approx([2.0, y - RESOLUTION, 12.0], abs=1e-5)


def test_inside_an_obstacle_the_range_is_zero_and_without_obstacles_the_maximum():
    occupied = np.zeros((20, 20), dtype=bool)
    occupied[10, 10] = True
    grid = OccupancyGrid(occupied, RESOLUTION)
    field = distance_field(occupied, RESOLUTION)
    bearings = np.linspace(-3, 3, 9)
    assert (raycast(grid, field, np.array([1.05, 1.05, 0.0]), bearings, 4.0) == 0.0).all()
    empty = OccupancyGrid(np.zeros((20, 20), dtype=bool), RESOLUTION)
    field = distance_field(empty.occupied, RESOLUTION)
    assert (raycast(empty, field, np.array([1.05, 1.05, 0.0]), bearings, 4.0) == 4.0).all()


def test_origin_moves_the_grid():
    occupied = np.zeros((20, 20), dtype=bool)
    occupied[:, 15] = True
    grid = OccupancyGrid(occupied, RESOLUTION, (-1.0, 2.0))
    field = distance_field(occupied, RESOLUTION)
    got = raycast(grid, field, np.array([-0.5, 3.0, 0.0]), np.array([0.0]), 4.0)
    assert got[0] == pytest.approx(1.0, abs=1e-5)


def test_sample_field_is_bilinear_between_centres_and_zero_outside():
    rng = np.random.default_rng(2)
    field = rng.random((6, 9)).astype(np.float32)
    for _ in range(100):
        x, y = rng.uniform(0.05, 0.85), rng.uniform(0.05, 0.55)
        c, r = x / RESOLUTION - 0.5, y / RESOLUTION - 0.5
        c0, r0 = min(int(c), 7), min(int(r), 4)
        a, b = c - c0, r - r0
        want = (1 - b) * ((1 - a) * field[r0, c0] + a * field[r0, c0 + 1]) + b * (
            (1 - a) * field[r0 + 1, c0] + a * field[r0 + 1, c0 + 1]
        )
        assert sample_field(field, 10.0, x, y) == pytest.approx(want, abs=1e-6)
    assert sample_field(field, 10.0, -0.01, 0.3) == 0.0
    assert sample_field(field, 10.0, 0.3, 0.61) == 0.0
