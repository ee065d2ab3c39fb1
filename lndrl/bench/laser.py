"""``lndrl bench laser``: scans of a room with 25 boxes, walls only and with people and noise."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig
from lndrl.kernels import kernel
from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.edges import ray_map
from lndrl.maps.raycast import cast_ray, clearance
from lndrl.randomness import stream_state
from lndrl.world.laser import Laser, beams_of, noisy_scan, trace

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

SIZE = (33.0, 20.0)
RESOLUTION = 0.05
BOXES = 25
POSES = 50
BODIES = 20
LEG_RADIUS = 0.1
SPARSE = 12
"""Stride of a scan that localization alone looks at: 60 of 720 beams."""
_WALL = 2  # cells
_CHECKED = 10  # poses whose ranges are compared with exact geometry
_RAYS = 20_000
_PASSES = 15


@dataclass(frozen=True)
class Scene:
    """The room: ``boxes`` ``(25, 4)`` [x0, y0, x1, y1] and ``poses`` ``(50, 3)`` in free places,
    ``legs`` ``(50, 40, 2)`` of bodies up to 8 m from each (m, rad).
    """

    grid: OccupancyGrid
    boxes: Floats
    poses: Floats
    legs: Floats
    laser: Laser


def make_scene() -> Scene:
    """33 x 20 m at 0.05 m with outer walls and boxes of 0.25 to 1.5 m; always the same."""
    rng = np.random.default_rng(25)
    sides = rng.uniform(0.25, 1.5, (BOXES, 2))
    corner = rng.uniform(0.5, np.array(SIZE) - 2.0, (BOXES, 2))
    boxes = np.concatenate([corner, corner + sides], axis=1)
    columns, rows = round(SIZE[0] / RESOLUTION), round(SIZE[1] / RESOLUTION)
    occupied = np.ones((rows, columns), dtype=np.bool_)
    occupied[_WALL:-_WALL, _WALL:-_WALL] = False
    x, y = (np.arange(columns) + 0.5) * RESOLUTION, (np.arange(rows) + 0.5) * RESOLUTION
    for x0, y0, x1, y1 in boxes:
        occupied |= ((y >= y0) & (y <= y1))[:, None] & ((x >= x0) & (x <= x1))[None, :]
    grid = OccupancyGrid(occupied, RESOLUTION)
    distance = distance_field(occupied, RESOLUTION)
    poses: list[tuple[float, float, float]] = []
    while len(poses) < POSES:
        at = rng.uniform(0.0, SIZE[0]), rng.uniform(0.0, SIZE[1])
        if distance[grid.index(*at)] > 0.3:
            poses.append((*at, rng.uniform(-np.pi, np.pi)))
    pose = np.array(poses)
    bodies = pose[:, None, :2] + rng.uniform(-8.0, 8.0, (POSES, BODIES, 2))
    turn = rng.uniform(0.0, np.pi, (POSES, BODIES))
    side = LEG_RADIUS * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    legs = np.concatenate([bodies - side, bodies + side], axis=1)
    laser = Laser(LaserConfig(), ray_map(grid, clearance(distance, RESOLUTION)))
    return Scene(grid, boxes, pose, legs, laser)


def measure(seconds: float) -> dict[str, Any]:
    """Median figures of scans at 50 poses, 720 beams over 180 degrees, 12 m.

    ``beams_per_second``: walls, as the simulator scans, from compiled code;
    ``beams_per_second_from_python`` with one Python call per scan.
    ``ray_march_beams_per_second``: single rays in random directions.
    ``scan_microseconds_20_bodies`` and ``sparse_scan_microseconds`` (60 beams) are whole scans:
    40 legs, noise. Errors are those of the walls against the grid's cells, and
    ``p95_error_to_boxes_metres`` against the boxes before they became cells.
    """
    scene = make_scene()
    laser = scene.laser
    parts = laser.rays, laser.fan, scene.poses
    state = stream_state(1)
    no_legs = np.zeros((POSES, 0, 2))
    full, sparse = (np.empty((POSES, beams_of(laser.config, n)), np.float32) for n in (1, SPARSE))
    rays, ranges = _random_rays(scene), np.empty(_RAYS, np.float32)
    cases: dict[str, Callable[[], Any]] = {
        "static": lambda: _trace_all(*parts, no_legs, 1, laser.scratch, full),
        "python": lambda: [laser.true_ranges(p, no_legs[0], LEG_RADIUS) for p in scene.poses],
        "march": lambda: _cast_all(laser.rays, rays, laser.config.range_max, ranges),
        "bodies": lambda: _scan_all(*parts, scene.legs, 1, state, laser.scratch, full),
        "sparse": lambda: _scan_all(*parts, scene.legs, SPARSE, state, laser.scratch, sparse),
    }
    times = alternate(cases, seconds)
    beams = laser.config.beams * POSES
    return {
        "beams_per_second": beams / times["static"],
        "beams_per_second_from_python": beams / times["python"],
        "ray_march_beams_per_second": _RAYS / times["march"],
        "scan_microseconds_20_bodies": 1e6 * times["bodies"] / POSES,
        "sparse_scan_microseconds": 1e6 * times["sparse"] / POSES,
        **errors(scene, [laser.true_ranges(p, no_legs[0], LEG_RADIUS) for p in scene.poses]),
    }


def alternate(cases: dict[str, Callable[[], Any]], seconds: float) -> dict[str, float]:
    """Median seconds of one call of each case, about ``seconds`` of calls each.

    Cases take turns, so that whatever else the machine does slows all of them alike.
    """
    times: dict[str, list[float]] = {name: [] for name in cases}
    for call in cases.values():
        call()  # compiles
    while any(sum(t) < seconds or len(t) < _PASSES for t in times.values()):
        for name, call in cases.items():
            # A case that has had its time rests, but never while it is one of few samples.
            if sum(times[name]) >= seconds and len(times[name]) >= _PASSES:
                continue
            started = perf_counter()
            call()
            times[name].append(perf_counter() - started)
    return {name: statistics.median(t) for name, t in times.items()}


def errors(scene: Scene, ranges: list[Floats32]) -> dict[str, float]:
    """Errors (m) of scans at the scene's poses against exact geometry."""
    cells = _as_boxes(scene.grid)
    width, height = SIZE
    wall = _WALL * RESOLUTION
    edge = [
        (-1.0, -1.0, width + 1.0, wall),
        (-1.0, height - wall, width + 1.0, height + 1.0),
        (-1.0, -1.0, wall, height + 1.0),
        (width - wall, -1.0, width + 1.0, height + 1.0),
    ]
    boxes = np.concatenate([scene.boxes, np.array(edge)])
    to_cells: list[Floats] = []
    to_boxes: list[Floats] = []
    for i in range(_CHECKED):
        angles = scene.poses[i, 2] + scene.laser.bearings
        for found, solid in ((to_cells, cells), (to_boxes, boxes)):
            want = _box_ranges(solid, scene.poses[i], angles, scene.laser.config.range_max)
            found.append(np.abs(ranges[i] - want))
    return {
        "median_error_metres": float(np.median(to_cells)),
        "p95_error_metres": float(np.quantile(to_cells, 0.95)),
        "p95_error_to_boxes_metres": float(np.quantile(to_boxes, 0.95)),
    }


def _as_boxes(grid: OccupancyGrid) -> Floats:
    """The grid's solid cells (m), those beside each other in a row as one box."""
    boxes = []
    for row, line in enumerate(grid.occupied):
        ends = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]])))
        boxes += [(a, row, b, row + 1) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    return grid.resolution * np.array(boxes, dtype=np.float64)


def _box_ranges(boxes: Floats, pose: Floats, angles: Floats, range_max: float) -> Floats:
    """Where rays enter the first box, by slabs."""
    inverse = 1.0 / np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
    a = (boxes[None, :, :2] - pose[:2]) * inverse
    b = (boxes[None, :, 2:] - pose[:2]) * inverse
    enter = np.minimum(a, b).max(axis=-1)
    hit = (enter <= np.maximum(a, b).min(axis=-1)) & (enter >= 0.0)
    return np.minimum(np.where(hit, enter, np.inf).min(axis=1), range_max)


def _random_rays(scene: Scene) -> Floats:
    """x, y, dx, dy of rays from the poses in random directions, ``(n, 4)``."""
    angle = np.random.default_rng(3).uniform(-np.pi, np.pi, _RAYS)
    start = scene.poses[np.arange(_RAYS) % POSES, :2]
    return np.concatenate([start, np.cos(angle)[:, None], np.sin(angle)[:, None]], axis=1)


@kernel(error_model="numpy")
def _trace_all(rays, fan, poses, legs, stride, scratch, out):
    for i in range(len(poses)):
        trace(rays, fan, poses[i], legs[i], LEG_RADIUS, stride, scratch, out[i])


@kernel(error_model="numpy")
def _scan_all(rays, fan, poses, legs, stride, state, scratch, out):
    for i in range(len(poses)):
        noisy_scan(rays, fan, poses[i], legs[i], LEG_RADIUS, stride, state, scratch, out[i])


@kernel(error_model="numpy")
def _cast_all(ray_map, rays, range_max, out):
    for i in range(len(rays)):
        out[i] = cast_ray(
            ray_map.cells,
            ray_map.inverse_resolution,
            ray_map.origin_x,
            ray_map.origin_y,
            rays[i, 0],
            rays[i, 1],
            rays[i, 2],
            rays[i, 3],
            range_max,
        )
