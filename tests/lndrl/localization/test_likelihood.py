"""Likelihood field: table, beam selection and weights against slow NumPy twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.errors import UserError
from lndrl.localization.belief import make_settings, room_for
from lndrl.localization.likelihood import (
    BEAMS_PER_PASS,
    LikelihoodMap,
    beam_ends,
    likelihood_field,
    to_cells,
)
from lndrl.maps.grid import OccupancyGrid

CONFIG = LocalizationConfig()


def random_grid(seed=0):
    occupied = np.random.default_rng(seed).random((60, 90)) < 0.02
    return OccupancyGrid(occupied, 0.1, (-1.0, 2.0))


def factor_twin(distance):
    d = np.minimum(distance, CONFIG.laser_likelihood_max_dist)
    hit = CONFIG.laser_z_hit * np.exp(-(d**2) / (2 * CONFIG.laser_sigma_hit**2))
    return (hit + CONFIG.laser_z_rand / CONFIG.laser_max_range) ** 3


def weights_twin(grid, poses, ranges, bearings):
    """ROS formula, brute force over obstacles; also how close any end is to a cell's edge."""
    rows, columns = np.nonzero(grid.occupied)
    height, width = grid.occupied.shape
    result = np.ones(len(poses))
    nearest_edge = np.full(len(poses), np.inf)
    for i, (x, y, yaw) in enumerate(poses):
        for r, b in zip(ranges, bearings, strict=True):
            if not (r < CONFIG.laser_max_range):
                continue
            u = (x + r * math.cos(yaw + b) - grid.origin[0]) / grid.resolution
            v = (y + r * math.sin(yaw + b) - grid.origin[1]) / grid.resolution
            column, row = math.floor(u), math.floor(v)
            edge = min(abs(u - round(u)), abs(v - round(v)))
            nearest_edge[i] = min(nearest_edge[i], edge)
            distance = np.inf
            if 0 <= column < width and 0 <= row < height:
                distance = np.hypot(rows - row, columns - column).min() * grid.resolution
            result[i] += factor_twin(distance)
    return result, nearest_edge


def weights(field, poses, ranges, bearings):
    count = len(poses)
    rows = np.array([*poses.T, np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    beams = np.zeros((2, len(ranges)), dtype=np.float32)
    kept, broken = beam_ends(ranges, bearings, CONFIG.laser_max_range, field.resolution, beams)
    cells = np.zeros((4, count), dtype=np.float32)
    to_cells(rows, count, field.resolution, *field.origin, cells)
    index = np.zeros((BEAMS_PER_PASS, room_for(count)), dtype=np.int32)
    out = np.zeros(count, dtype=np.float32)
    likelihood_field(field.table.ravel(), *field.table.shape, cells, count, beams, kept, index, out)
    return out, kept, broken


def test_table_matches_formula_and_border_is_off_map():
    grid = random_grid()
    field = LikelihoodMap.build(grid, CONFIG)
    rows, columns = np.nonzero(grid.occupied)
    for row, column in [(0, 0), (59, 89), (30, 17), (rows[3], columns[3])]:
        distance = np.hypot(rows - row, columns - column).min() * 0.1
        assert field.table[row + 1, column + 1] == pytest.approx(factor_twin(distance), rel=1e-5)
    border = np.concatenate([field.table[[0, -1]].ravel(), field.table[:, [0, -1]].ravel()])
    assert np.allclose(border, factor_twin(np.inf), rtol=1e-6)
    assert set(field.free_cells) == set(np.flatnonzero(~grid.occupied))


@pytest.mark.parametrize("beams", [1, 3, 4, 23])
def test_weights_match_twin_also_off_the_map(beams):
    rng = np.random.default_rng(beams)
    grid = random_grid(beams)
    field = LikelihoodMap.build(grid, CONFIG)
    poses = np.column_stack(
        [rng.uniform(-4, 11, 150), rng.uniform(-1, 11, 150), rng.uniform(-3.1, 3.1, 150)]
    )
    ranges = rng.uniform(0.2, 13.0, beams).astype(np.float32)
    bearings = np.linspace(-1.5, 1.5, beams).astype(np.float32)
    found, kept, _ = weights(field, poses, ranges, bearings)
    expected, edge = weights_twin(grid, poses, ranges, bearings)
    clear = edge > 1e-3  # ends on a cell's edge may fall either way in float32
    assert kept == (ranges < 12.0).sum()
    assert clear.sum() > 100
    assert np.allclose(found[clear], expected[clear], rtol=2e-5)


def test_cells_lie_where_the_map_server_puts_them():
    occupied = np.zeros((20, 20), dtype=bool)
    occupied[7, 12] = True  # covers x in [1.2, 1.3), y in [0.7, 0.8)
    field = LikelihoodMap.build(OccupancyGrid(occupied, 0.1), CONFIG)
    bearings = np.zeros(1, dtype=np.float32)
    ranges = np.array([1.0], dtype=np.float32)
    inside = np.array([[0.201, 0.701, 0.0], [0.299, 0.799, 0.0]])
    outside = np.array([[0.199, 0.75, 0.0], [0.301, 0.75, 0.0], [0.25, 0.699, 0.0]])
    assert np.allclose(weights(field, inside, ranges, bearings)[0], 1 + factor_twin(0.0))
    assert np.allclose(weights(field, outside, ranges, bearings)[0], 1 + factor_twin(0.1))


def test_unusable_readings_are_left_out():
    ranges = np.array([1.0, np.nan, 12.0, np.inf, -np.inf, -1.0, 11.9, 2.0], dtype=np.float32)
    bearings = np.zeros(8, dtype=np.float32)
    bearings[7] = np.nan
    beams = np.zeros((2, 8), dtype=np.float32)
    kept, broken = beam_ends(ranges, bearings, 12.0, 0.5, beams)
    assert (kept, broken) == (2, 4)
    assert np.allclose(beams[0, :2], [2.0, 23.8])
    field = LikelihoodMap.build(random_grid(), CONFIG)
    nothing = weights(field, np.zeros((3, 3)), ranges[1:5], bearings[1:5])[0]
    assert (nothing == 1.0).all()


def test_empty_and_full_maps():
    empty = LikelihoodMap.build(OccupancyGrid(np.zeros((5, 5), dtype=bool), 0.1), CONFIG)
    assert np.allclose(empty.table, factor_twin(np.inf))
    with pytest.raises(UserError, match="no free cell"):
        LikelihoodMap.build(OccupancyGrid(np.ones((5, 5), dtype=bool), 0.1), CONFIG)


@pytest.mark.parametrize("count", [1, 2, 31, 64, 501])
def test_sums_are_the_look_ups_of_four_beams_at_a_time(count: int) -> None:
    """Bit by bit: the order of the additions is part of what a seed replays."""
    rng = np.random.default_rng(count)
    rows, columns = 60, 90
    table = rng.random((rows, columns)).astype(np.float32)
    room = room_for(count)
    cells = rng.uniform(-1.0, 1.0, (4, room)).astype(np.float32)
    # Particles at whole cells and a quarter: nothing rounds, so the twin's cells are exact.
    cells[0], cells[1] = rng.integers(-9, 99, room) + 0.25, rng.integers(-9, 69, room) + 0.25
    cells[2], cells[3] = np.where(rng.random(room) < 0.5, [[1.0], [0.0]], [[0.0], [-1.0]])
    for kept in (0, 1, 3, 4, 7, 46):
        beams = rng.integers(-40, 40, (2, 50)).astype(np.float32)
        x = cells[0, :, None] + cells[2, :, None] * beams[0] - cells[3, :, None] * beams[1]
        y = cells[1, :, None] + cells[3, :, None] * beams[0] + cells[2, :, None] * beams[1]
        column = x.clip(0.5, columns - 0.5).astype(np.int64)
        values = table[y.clip(0.5, rows - 0.5).astype(np.int64), column].T
        expected = np.ones(room, np.float32)
        for b in range(0, kept - kept % 4, 4):
            expected += (values[b] + values[b + 1]) + (values[b + 2] + values[b + 3])
        for b in range(kept - kept % 4, kept):
            expected += values[b]
        index = np.zeros((BEAMS_PER_PASS, room), np.int32)
        out = np.zeros(count + 1, np.float32)
        likelihood_field(table.ravel(), rows, columns, cells, count, beams, kept, index, out)
        assert (out[:count] == expected[:count]).all() and out[count] == 0.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -1e300])
def test_what_is_not_finite_lies_off_the_map_and_is_no_index(value: float) -> None:
    field = LikelihoodMap.build(random_grid(), CONFIG)
    rows, columns = field.table.shape
    particles = np.full((5, 64), value)
    cells = np.zeros((4, 64), np.float32)
    to_cells(particles, 64, 0.1, *field.origin, cells)
    assert np.isfinite(cells).all()
    beams = np.array([[3.0, -200.0], [50.0, 0.0]], np.float32)
    index = np.zeros((BEAMS_PER_PASS, 64), np.int32)
    likelihood = np.zeros(50, np.float32)
    likelihood_field(field.table.ravel(), rows, columns, cells, 50, beams, 2, index, likelihood)
    assert 0 <= index.min() <= index.max() < field.table.size
    assert (likelihood >= 1.0).all() and np.isfinite(likelihood).all()


@pytest.mark.parametrize("farthest", [12.0, 5.6, 4.1, 25.4])
def test_a_missed_echo_is_none_even_where_single_precision_rounds_it_down(farthest):
    laser = LaserConfig(range_max=farthest)
    settings = make_settings(LocalizationConfig(laser_max_range=-1), laser)
    missed, nearer = np.float32(farthest), np.float32(farthest - 0.01)
    ends = np.zeros((2, 2), np.float32)
    readings = np.array([missed, nearer], np.float32)
    assert beam_ends(readings, np.zeros(2, np.float32), settings.range_max, 0.05, ends) == (1, 0)
    assert ends[0, 0] == pytest.approx(nearer / 0.05)
