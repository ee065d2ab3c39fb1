"""Scan conversion against a cell walk in plain Python and against exact segments."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lndrl.config import LaserConfig
from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.edges import RayMap, arctangent, faces_in_reach, ray_map, scan_faces
from lndrl.maps.raycast import clearance
from lndrl.world.laser import (
    make_fan,
    make_scan_scratch,
    scan_rays,
    trace,
    trace_walls,
)

NO_LEGS = np.zeros((0, 2))


def map_of(occupied: np.ndarray, resolution: float = 0.1, origin=(0.0, 0.0)) -> RayMap:
    cells = clearance(distance_field(occupied, resolution), resolution)
    return ray_map(OccupancyGrid(occupied, resolution, origin), cells)


def by_faces(rays: RayMap, config: LaserConfig, pose: np.ndarray, stride: int = 1) -> np.ndarray:
    """Ranges by scan conversion, whatever the cost rule says; the pose is in a free cell."""
    fan = make_fan(config)
    out = np.full((config.beams + stride - 1) // stride, config.range_max, np.float32)
    scale = rays.inverse_resolution
    x, y = (pose[0] - rays.origin_x) * scale, (pose[1] - rays.origin_y) * scale
    scan_faces(rays, x, y, pose[2], fan, stride, make_scan_scratch(config.beams).faces, out)
    return out


def by_rays(rays: RayMap, config: LaserConfig, pose: np.ndarray, stride: int = 1) -> np.ndarray:
    out = np.empty((config.beams + stride - 1) // stride, np.float32)
    scan_rays(rays, make_fan(config), pose, stride, out)
    return out


def cell_walk(occupied: np.ndarray, x: float, y: float, angle: float) -> float:
    """Slow twin, in cells: the parameters of all cell borders on the ray, sorted, and the cell in
    the middle between two of them. Infinite without a hit."""
    dx, dy = math.cos(angle), math.sin(angle)
    rows, columns = occupied.shape
    cuts = [0.0]
    if abs(dx) > 1e-12:
        cuts += [(i - x) / dx for i in range(columns + 1)]
    if abs(dy) > 1e-12:
        cuts += [(i - y) / dy for i in range(rows + 1)]
    cuts = sorted(t for t in cuts if t >= 0.0)
    for begin, end in zip(cuts, [*cuts[1:], cuts[-1] + 1.0], strict=True):
        if end - begin < 1e-12:
            continue
        middle = 0.5 * (begin + end)
        column, row = math.floor(x + middle * dx), math.floor(y + middle * dy)
        if not (0 <= row < rows and 0 <= column < columns):
            return math.inf
        if occupied[row, column]:
            return begin
    return math.inf


NUDGES = [(1e-7, 0, 0), (-1e-7, 0, 0), *((0, a, b) for a in (-1e-7, 1e-7) for b in (-1e-7, 1e-7))]


def agrees(
    occupied: np.ndarray, x: float, y: float, angle: float, got: float, limit: float
) -> bool:
    """Whether ``got`` (cells) is the walk's range, or, where the ray meets a corner or follows a
    face, lies between those of two rays next to it: which cell it meets is a matter of taste."""
    if abs(got - min(cell_walk(occupied, x, y, angle), limit)) < 1e-4:
        return True
    walks = [
        min(cell_walk(occupied, x + ox, y + oy, angle + turn), limit) for turn, ox, oy in NUDGES
    ]
    return min(walks) - 1e-4 <= got <= max(walks) + 1e-4 and max(walks) - min(walks) > 1e-4


GRIDS = st.tuples(
    st.integers(2, 24), st.integers(2, 24), st.floats(0.01, 0.5), st.integers(0, 2**32 - 1)
)
# Everything between cell corners and anything; headings on the axes and diagonals often.
PLACES = st.one_of(st.floats(0.0, 0.999), st.sampled_from([0.0, 0.25, 0.5, 0.75]))
HEADINGS = st.one_of(
    st.floats(-20.0, 20.0), st.integers(-8, 8).map(lambda n: n * np.pi / 4), st.just(np.pi - 1e-9)
)
VIEWS = st.sampled_from([np.pi, 2 * np.pi, 1.5 * np.pi, 0.3])


@settings(max_examples=150)
@example((2, 4, 0.5, 0), 0.25, 0.5, 0.0, 0.0, 0.0, np.pi, 3)  # on a wall's face, at its end
@given(GRIDS, PLACES, PLACES, PLACES, PLACES, HEADINGS, VIEWS, st.sampled_from([3, 16, 61]))
def test_faces_equal_the_cell_walk(shape, px, py, fx, fy, yaw, view, beams) -> None:
    rows, columns, density, seed = shape
    occupied = np.random.default_rng(seed).random((rows, columns)) < density
    row, column = int(py * rows), int(px * columns)
    occupied[row, column] = False
    x, y = column + fx, row + fy
    config = LaserConfig(beams=beams, field_of_view=view, range_max=9.0)
    got = by_faces(map_of(occupied, 1.0), config, np.array([x, y, yaw]))
    for i, one in enumerate(got):
        angle = yaw - 0.5 * view + i * view / beams
        assert agrees(occupied, x, y, angle, float(one), 9.0), (i, one)


def random_rooms(seed: int, rectangles: int = 25) -> tuple[np.ndarray, np.ndarray]:
    """33 x 20 m at 0.05 m with walls; also the rectangles [x0, y0, x1, y1] (m) before rastering."""
    rng = np.random.default_rng(seed)
    centre = np.stack([rng.uniform(1, 32, rectangles), rng.uniform(1, 19, rectangles)], axis=1)
    half = rng.uniform(0.125, 0.75, (rectangles, 2))
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    boxes = np.concatenate(
        [boxes, [[-1, -1, 34, 0.1], [-1, 19.9, 34, 21], [-1, -1, 0.1, 21], [32.9, -1, 34, 21]]]
    )
    x = (np.arange(660) + 0.5) * 0.05
    y = (np.arange(400) + 0.5) * 0.05
    occupied = np.zeros((400, 660), dtype=bool)
    for x0, y0, x1, y1 in boxes:
        occupied |= ((y >= y0) & (y <= y1))[:, None] & ((x >= x0) & (x <= x1))[None, :]
    return occupied, boxes


def free_poses(occupied: np.ndarray, count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    field = distance_field(occupied, 0.05)
    poses: list[tuple[float, float, float]] = []
    while len(poses) < count:
        x, y = rng.uniform(0, 33), rng.uniform(0, 20)
        if field[int(y / 0.05), int(x / 0.05)] > 0.15:
            poses.append((x, y, rng.uniform(-np.pi, np.pi)))
    return np.array(poses)


def box_ranges(
    boxes: np.ndarray, pose: np.ndarray, bearings: np.ndarray, limit: float
) -> np.ndarray:
    """Nearest entry into a box along every ray by the slab method, float64."""
    angle = pose[2] + bearings[:, None]
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    near = (boxes[None, :, :2] - pose[:2]) / direction
    far = (boxes[None, :, 2:] - pose[:2]) / direction
    enter = np.minimum(near, far).max(axis=-1)
    leave = np.maximum(near, far).min(axis=-1)
    hit = (enter <= leave) & (enter >= 0)
    return np.minimum(np.where(hit, enter, np.inf).min(axis=1), limit)


def grid_boxes(occupied: np.ndarray) -> np.ndarray:
    """The grid's own cells as boxes, one per row and run of cells (m)."""
    boxes = []
    for row, line in enumerate(occupied):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        boxes += [(a, row, b, row + 1) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return 0.05 * np.array(boxes, dtype=float)


def test_ranges_are_exact_against_the_cells_and_within_a_cell_of_the_rectangles() -> None:
    occupied, boxes = random_rooms(1)
    rays = map_of(occupied, 0.05)
    config = LaserConfig(beams=360)
    bearings = -0.5 * np.pi + np.arange(360) * np.pi / 360
    cells = grid_boxes(occupied)
    against_boxes = []
    for pose in free_poses(occupied, 25, 2):
        got = by_faces(rays, config, pose)
        assert got == pytest.approx(box_ranges(cells, pose, bearings, 12.0), abs=1e-4)
        against_boxes.append(np.abs(got - box_ranges(boxes, pose, bearings, 12.0)))
    errors = np.concatenate(against_boxes)
    # A face is at most half a cell off; only rays that graze a corner or a face err by more.
    assert np.median(errors) < 0.02
    assert (errors <= 0.05).mean() > 0.9


@pytest.mark.parametrize("view", [np.pi, 2 * np.pi])
@pytest.mark.parametrize("stride", [1, 7, 12])
def test_both_ways_give_the_same_ranges(view, stride) -> None:
    occupied, _ = random_rooms(3)
    rays = map_of(occupied, 0.05)
    config = LaserConfig(field_of_view=view)
    for pose in free_poses(occupied, 40, 4):
        faces = by_faces(rays, config, pose, stride)
        assert faces == pytest.approx(by_rays(rays, config, pose, stride), abs=1e-4)


def test_a_map_of_many_faces_is_followed_ray_by_ray_when_beams_are_few() -> None:
    occupied = np.random.default_rng(5).random((300, 300)) < 0.02
    occupied[150, 150] = False
    rays = map_of(occupied, 0.1)
    pose = np.array([15.05, 15.03, 0.4])
    assert faces_in_reach(rays, 150.5, 150.3, 120.0) > 8 * 60
    config = LaserConfig()
    fan, scratch = make_fan(config), make_scan_scratch(720)
    for stride in (1, 12):
        out = np.empty((720 + stride - 1) // stride, np.float32)
        trace_walls(rays, fan, pose, stride, scratch.faces, out)
        assert out == pytest.approx(by_faces(rays, config, pose, stride), abs=1e-4)
        assert out == pytest.approx(by_rays(rays, config, pose, stride), abs=1e-4)


def test_wide_maps_are_cut_into_bands_without_a_trace() -> None:
    rng = np.random.default_rng(6)
    occupied = np.zeros((900, 700), dtype=bool)
    for _ in range(60):
        row, column = rng.integers(0, 880), rng.integers(0, 690)
        occupied[row : row + rng.integers(1, 200), column : column + rng.integers(1, 8)] = True
    rays = map_of(occupied, 0.1)
    assert rays.starts.shape[1] > 3
    config = LaserConfig(field_of_view=2 * np.pi)
    for _ in range(30):
        pose = np.array([rng.uniform(0, 70), rng.uniform(0, 90), rng.uniform(-3, 3)])
        if not occupied[int(pose[1] * 10), int(pose[0] * 10)]:
            assert by_faces(rays, config, pose) == pytest.approx(
                by_rays(rays, config, pose), abs=1e-4
            )


def test_faces_of_one_wall_are_one_face() -> None:
    occupied = np.zeros((30, 40), dtype=bool)
    occupied[10:20, 15:25] = True
    rays = map_of(occupied)
    assert sorted(zip(rays.position, rays.low, rays.high, strict=True)) == [
        (10, 15, 25), (15, 10, 20), (20, 15, 25), (25, 10, 20)
    ]  # fmt: skip


def test_in_a_wall_everything_is_near_and_off_the_map_nothing_is() -> None:
    occupied = np.zeros((20, 20), dtype=bool)
    occupied[10, 10] = True
    rays, fan, scratch = map_of(occupied), make_fan(LaserConfig(beams=8)), make_scan_scratch(8)
    out = np.empty(8, np.float32)
    for pose, want in [
        ((1.05, 1.05, 0.3), 0.0),
        ((-0.5, 1.0, 0.0), 12.0),
        ((1.0, 2.5, 0.0), 12.0),
        ((np.nan, 1.0, 0.0), 12.0),
        ((0.5, 0.5, np.nan), 12.0),
        ((np.inf, 1.0, 0.0), 12.0),
    ]:
        trace(rays, fan, np.array(pose), np.array([[1.5, 1.5]]), 0.1, 1, scratch, out)
        if np.isfinite(pose).all() and want:
            trace(rays, fan, np.array(pose), NO_LEGS, 0.1, 1, scratch, out)
        assert (out == want).all()


def test_origin_moves_the_map() -> None:
    occupied, _ = random_rooms(7)
    config = LaserConfig(beams=90)
    here, moved = map_of(occupied, 0.05), map_of(occupied, 0.05, (-3.0, 8.0))
    fan, scratch = make_fan(config), make_scan_scratch(90)
    a, b = np.empty((2, 90), np.float32)
    for pose in free_poses(occupied, 5, 8):
        trace(here, fan, pose, NO_LEGS, 0.1, 1, scratch, a)
        trace(moved, fan, pose + np.array([-3.0, 8.0, 0.0]), NO_LEGS, 0.1, 1, scratch, b)
        assert a == pytest.approx(b, abs=1e-4)


def test_arctangent_is_the_angle_to_float32() -> None:
    rng = np.random.default_rng(9)
    y = (rng.uniform(-1, 1, 20_000) * 10.0 ** rng.uniform(-6, 3, 20_000)).astype(np.float32)
    x = (rng.uniform(0, 1, 20_000) * 10.0 ** rng.uniform(-6, 3, 20_000)).astype(np.float32)
    got = np.array([arctangent(b, a) for a, b in zip(x, y, strict=True)], dtype=float)
    assert np.abs(got - np.arctan2(y.astype(float), x.astype(float))).max() < 2e-7
