"""Static scans by raycast2D and range_libc, in turns with ours: same grid, poses and beams."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.laser import LEG_RADIUS, POSES, Scene, alternate, errors, make_scene

Ranges = list[NDArray[Any]]
Case = tuple[Callable[[], Ranges], Callable[[Ranges], Ranges]]
"""All scans, timed, and what turns their answers into metres, untimed."""

RANGE_LIBC = "pip install pyrangelibc-danieldugas (builds with Cython below 3)"
_CDDT_BINS = 720
_METHODS = {
    "range_libc_ray_marching": "PyRayMarching",
    "range_libc_bresenham": "PyBresenhamsLine",
    "range_libc_cddt": "PyCDDTCast",
}


def measure_peers(seconds: float) -> dict[str, Any]:
    """``beams_per_second`` and errors of each peer; ``ours_times_as_fast`` compares it with ours
    as one Python call per scan, the way the peers are called.
    """
    scene = make_scene()
    figures: dict[str, Any] = {}
    cases: dict[str, Case] = {}
    for name, make, missing in _peers():
        try:
            case = make(scene)
            case[0]()
        except ImportError:
            figures[name] = {"missing": missing}
        except Exception as error:
            figures[name] = {"failed": f"{type(error).__name__}: {error}"}
        else:
            cases[name] = case
    laser, no_legs = scene.laser, np.zeros((0, 2))

    def ours() -> Ranges:
        return [laser.true_ranges(pose, no_legs, LEG_RADIUS) for pose in scene.poses]

    times = alternate({"ours": ours, **{name: scan for name, (scan, _) in cases.items()}}, seconds)
    beams = laser.config.beams * POSES
    for name, (scan, ranges) in cases.items():
        figures[name] = {
            "beams_per_second": beams / times[name],
            "ours_times_as_fast": times[name] / times["ours"],
            **errors(scene, ranges(scan())),
        }
    return figures


def _peers() -> list[tuple[str, Callable[[Scene], Case], str]]:
    libc = [
        (name, lambda scene, kind=kind: _range_libc(scene, kind), RANGE_LIBC)
        for name, kind in _METHODS.items()
    ]
    return [("raycast2D", _raycast2d, "pip install raycast2D"), *libc]


def _raycast2d(scene: Scene) -> Case:
    """Its pose is a cell, its heading 0 points to -y, its rays end in cells: ranges are made
    from them untimed. Its last beam would lie at the end of the view, ours stops before it.
    """
    module = importlib.import_module("raycast2D")
    config, resolution = scene.laser.config, scene.grid.resolution
    lidar = module.Lidar2D(
        num_rays=config.beams,
        FOV=round(math.degrees(config.field_of_view)),
        ray_length=round(config.range_max / resolution),
        occupancy_grid=scene.grid.free.astype(np.uint8),
    )
    lidar.angles = scene.laser.bearings.copy()
    cells = [
        (int(x / resolution), int(y / resolution), yaw + math.pi / 2) for x, y, yaw in scene.poses
    ]

    def scan() -> Ranges:
        return [lidar.scan(cell, only_true_collisions=False) for cell in cells]

    def ranges(ends: Ranges) -> Ranges:
        far = config.range_max
        return [
            np.minimum(resolution * np.hypot(end[:, 0] - float(x), end[:, 1] - float(y)), far)
            for (x, y, _), end in zip(cells, ends, strict=True)
        ]

    return scan, ranges


def _range_libc(scene: Scene, kind: str) -> Case:
    """Queries [column, row, angle] and room for answers are prepared beforehand."""
    module = importlib.import_module("range_libc")
    config, resolution = scene.laser.config, scene.grid.resolution
    cells = config.range_max / resolution
    bins = [_CDDT_BINS] if kind == "PyCDDTCast" else []
    # It keeps the address of its map, not the map.
    solid = np.ascontiguousarray(scene.grid.occupied)
    world = module.PyOMap(solid)
    method = getattr(module, kind)(world, cells, *bins)
    queries, answers = [], np.zeros((len(scene.poses), config.beams), np.float32)
    for x, y, yaw in scene.poses:
        query = np.empty((config.beams, 3), np.float32)
        query[:, 0], query[:, 1] = x / resolution, y / resolution
        query[:, 2] = yaw + scene.laser.bearings
        queries.append(query)

    def scan() -> Ranges:
        for query, answer in zip(queries, answers, strict=True):
            method.calc_range_many(query, answer)
        return list(answers)

    def ranges(found: Ranges) -> Ranges:
        _ = world, solid
        return [np.minimum(resolution * cells_away, config.range_max) for cells_away in found]

    return scan, ranges
