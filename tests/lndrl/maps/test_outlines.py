"""Outlines: closed, solid on the left, near the cells, few corners."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from lndrl.maps.grid import OccupancyGrid, grid_from_scenario
from lndrl.maps.outlines import geometry_outlines, grid_outlines, segments, signed_area
from lndrl.scenario import Scenario

STEP = 0.05


def blobs(seed: int, rows: int, columns: int, smooth: float) -> OccupancyGrid:
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(rows, columns)), smooth)
    occupied = noise > 0.0
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    return OccupancyGrid(occupied, STEP)


def border_edges(grid: OccupancyGrid) -> np.ndarray:
    """Edges between solid and free cells, (E, 4) (m)."""
    solid = np.pad(grid.occupied, 1, constant_values=True)
    out = []
    for r, c in np.argwhere(solid[:, 1:] != solid[:, :-1]):
        out.append((c, r - 1, c, r))
    for r, c in np.argwhere(solid[1:] != solid[:-1]):
        out.append((c - 1, r, c, r))
    return np.array(out, float).reshape(-1, 4) * STEP


def distance_to(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """From each point (n, 2) to the nearest edge."""
    a, b = edges[:, :2], edges[:, 2:]
    d = b - a
    u = np.einsum("nij,ij->ni", points[:, None] - a, d) / np.maximum((d**2).sum(1), 1e-12)
    near = a + np.clip(u, 0, 1)[..., None] * d
    return np.hypot(*(points[:, None] - near).transpose(2, 0, 1)).min(axis=1)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(4, 30), st.integers(4, 30), st.floats(0.4, 3.0))
def test_outlines_of_a_grid(seed, rows, columns, smooth) -> None:
    grid = blobs(seed, rows, columns, smooth)
    outlines = grid_outlines(grid)
    if grid.occupied.all():
        assert outlines == ()
        return
    edges = segments(outlines)
    along = np.concatenate(
        [edges[:, :2] + u * (edges[:, 2:] - edges[:, :2]) for u in (0, 0.3, 0.7)]
    )
    assert distance_to(along, border_edges(grid)).max() <= 0.5 * STEP + 1e-9
    corners = border_edges(grid)
    middles = 0.5 * (corners[:, :2] + corners[:, 2:])
    assert distance_to(middles, edges).max() <= 0.5 * STEP + 1e-9
    # Solid on the left: the enclosed areas, with their signs, leave the free floor.
    area = sum(signed_area(outline) for outline in outlines)
    free = grid.free.sum() * STEP**2
    length = np.hypot(*(edges[:, 2:] - edges[:, :2]).T).sum()
    assert -area == pytest.approx(free, abs=0.3 * STEP * length)
    assert area < 0


def test_solid_lies_on_the_left_of_every_long_edge() -> None:
    inner = blobs(3, 80, 120, 4.0)
    grid = OccupancyGrid(np.pad(inner.occupied, 2, constant_values=True), STEP)
    checked = 0
    for x0, y0, x1, y1 in segments(grid_outlines(grid)):
        length = np.hypot(x1 - x0, y1 - y0)
        if length < 3 * STEP:
            continue
        left = np.array([y0 - y1, x1 - x0]) / length
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
        assert grid.occupied[grid.index(*(middle + 1.2 * STEP * left))]
        assert not grid.occupied[grid.index(*(middle - 1.2 * STEP * left))]
        checked += 1
    assert checked > 40


def test_straight_and_slanted_walls_need_few_corners() -> None:
    occupied = np.ones((100, 200), bool)
    occupied[10:90, 10:190] = False
    x, y = np.meshgrid(np.arange(200), np.arange(100))
    occupied |= (abs(x - y - 40) < 4) & (y > 30) & (y < 70)  # a slab at 45 degrees
    outlines = grid_outlines(OccupancyGrid(occupied, STEP))
    assert sorted(len(o) for o in outlines)[-1] <= 12
    assert len(outlines) == 2
    assert sorted(np.sign(signed_area(o)) for o in outlines) == [-1, 1]


def test_the_origin_is_left_out() -> None:
    grid = blobs(1, 30, 30, 2.0)
    moved = OccupancyGrid(grid.occupied, STEP, (7.0, -3.0))
    assert all(
        (a == b).all() for a, b in zip(grid_outlines(grid), grid_outlines(moved), strict=True)
    )


def test_geometry_keeps_its_exact_shapes() -> None:
    scenario = Scenario.model_validate(
        {
            "name": "small",
            "size": [10, 6],
            "obstacles": [
                {"box": [4, 1, 5, 4]},
                {"circle": [8, 4.5, 0.4]},
                {"polygon": [[1, 4], [2, 5], [2, 4]]},  # clockwise
            ],
            "pedestrians": {"count": [0, 0]},
            "robot": [{"start": [1, 1, 2, 2], "goal": [7, 1, 9, 3]}],
        }
    )
    wall, box, circle, polygon = geometry_outlines(scenario)
    assert signed_area(wall) == pytest.approx(-9.8 * 5.8)
    assert signed_area(box) == pytest.approx(3.0)
    assert signed_area(polygon) == pytest.approx(0.5)
    assert len(circle) == 15 and np.hypot(*(circle - (8, 4.5)).T) == pytest.approx(0.4)
    assert 0.9 < signed_area(circle) / (np.pi * 0.16) < 1
    edges = segments((wall, box))
    assert edges.shape == (8, 4)
    assert (edges[:4, 2:] == np.roll(edges[:4, :2], -1, axis=0)).all()
    free = grid_from_scenario(scenario).free.sum() * 0.0025
    total = sum(signed_area(o) for o in geometry_outlines(scenario))
    assert -total == pytest.approx(free, rel=0.01)
    assert len(geometry_outlines(scenario.model_copy(update={"wall": 0.0}))) == 3
    assert segments(()).shape == (0, 4)
