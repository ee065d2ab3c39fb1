"""Beam model against the published formula with rays sampled along the grid."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lndrl.localization.beam_model import beam_model, prepare_readings
from lndrl.maps.grid import OccupancyGrid, distance_field
from lndrl.maps.raycast import clearance

NUMBERS = (0.6, 0.1, 0.05, 0.25, 0.15, 0.3)  # z_hit, z_short, z_max, z_rand, sigma, lambda
FARTHEST = 6.0


def room():
    occupied = np.zeros((50, 60), dtype=bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[20:28, 30:40] = True
    return OccupancyGrid(occupied, 0.1, (-2.0, 1.0))


def expected_range(grid, x, y, angle):
    along = np.arange(0.0, FARTHEST, 0.001)
    column = np.floor((x + along * math.cos(angle) - grid.origin[0]) / 0.1).astype(int)
    row = np.floor((y + along * math.sin(angle) - grid.origin[1]) / 0.1).astype(int)
    hit = grid.occupied[row.clip(0, 49), column.clip(0, 59)]
    return along[hit.argmax()] if hit.any() else FARTHEST


def twin(grid, poses, ranges, bearings):
    z_hit, z_short, z_max, z_rand, sigma, decay = NUMBERS
    weights = np.ones(len(poses))
    for i, (x, y, yaw) in enumerate(poses):
        for z, bearing in zip(np.minimum(ranges, FARTHEST), bearings, strict=True):
            error = z - expected_range(grid, x, y, yaw + bearing)
            p = z_hit * math.exp(-error * error / (2 * sigma**2))
            p += z_short * decay * math.exp(-decay * z) if error < 0 else 0.0
            p += z_max if z >= FARTHEST else z_rand / FARTHEST
            weights[i] += p**3
    return weights


def kernel(grid, poses, ranges, bearings):
    field = SimpleNamespace(
        clearance=clearance(distance_field(grid.occupied, grid.resolution), grid.resolution),
        resolution=grid.resolution, origin_x=grid.origin[0], origin_y=grid.origin[1],
    )  # fmt: skip
    readings = np.zeros((5, len(ranges)))
    kept = prepare_readings(ranges, bearings, FARTHEST, NUMBERS, readings)
    out = np.zeros(len(poses), dtype=np.float32)
    rows = np.array([*poses.T, np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    beam_model.py_func(rows, len(poses), readings, kept, field, FARTHEST, NUMBERS, out)
    return out, kept


def test_weights_match_the_formula():
    rng = np.random.default_rng(1)
    grid = room()
    x, y = rng.uniform(-1.5, 3.5, 40), rng.uniform(1.5, 5.5, 40)
    poses = np.column_stack([x, y, rng.uniform(-3, 3, 40)])
    bearings = np.linspace(-1.5, 1.5, 15).astype(np.float32)
    # From one pose, so that hits occur, with short, missed and longer readings among them.
    ranges = np.array([expected_range(grid, -0.5, 3.0, 0.3 + b) for b in bearings], np.float32)
    poses[:10] = np.add([-0.5, 3.0, 0.3], rng.normal(0, 0.03, (10, 3)))
    ranges[::4] = [0.5, FARTHEST, 2.0, 7.5]
    found, kept = kernel(grid, poses, ranges, bearings)
    expected = twin(grid, poses, ranges, bearings)
    assert kept == 15
    # A ray that grazes a corner may go either way at a step of 1 mm.
    close = np.isclose(found, expected, rtol=0.02)
    assert close.mean() > 0.9
    assert np.median(np.abs(found / expected - 1)) < 3e-3
    assert found[:10].mean() > found[10:].mean() + 0.5


def test_missed_echoes_stay_and_broken_readings_go():
    ranges = np.array([1.0, np.nan, 9.0, np.inf, -1.0, 6.0], dtype=np.float32)
    readings = np.zeros((5, 6))
    kept = prepare_readings(ranges, np.zeros(6, np.float32), FARTHEST, NUMBERS, readings)
    assert kept == 3
    assert readings[2, :3].tolist() == [1.0, 6.0, 6.0]
    assert readings[4, :3] == pytest.approx([0.25 / 6.0, 0.05, 0.05])
    assert readings[3, 0] == pytest.approx(0.1 * 0.3 * math.exp(-0.3))
