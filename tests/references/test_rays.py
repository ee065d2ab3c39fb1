"""Rays against raycast2D, an independent ray caster on images (GPL, for tests only)."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.bench.laser import LEG_RADIUS, RESOLUTION, Scene, make_scene

raycast2d = pytest.importorskip("raycast2D")

NO_LEGS = np.zeros((0, 2))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene()


def reference(scene: Scene, cell: tuple[int, int], yaw: float) -> np.ndarray:
    """Ranges (m) from the cell; its heading 0 points to -y, its ends are cells."""
    config = scene.laser.config
    lidar = raycast2d.Lidar2D(
        num_rays=config.beams,
        ray_length=round(config.range_max / RESOLUTION),
        occupancy_grid=scene.grid.free.astype(np.uint8),
    )
    lidar.angles = scene.laser.bearings.copy()
    ends = lidar.scan((*cell, yaw + np.pi / 2), only_true_collisions=False).astype(float)
    return np.minimum(RESOLUTION * np.hypot(*(ends - cell).T), config.range_max)


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2, np.pi, -2.0])
def test_ranges_are_those_of_raycast2d_to_a_cell(scene: Scene, turn: float) -> None:
    """It starts in the middle of a cell and ends in one: ranges differ by a cell or less, the
    more so along walls, so the median and the 95 % quantile are compared."""
    errors = []
    for pose in scene.poses[:20]:
        cell = int(pose[0] / RESOLUTION), int(pose[1] / RESOLUTION)
        middle = np.array([(cell[0] + 0.5) * RESOLUTION, (cell[1] + 0.5) * RESOLUTION, turn])
        want = reference(scene, cell, turn)
        ours = scene.laser.true_ranges(middle, NO_LEGS, LEG_RADIUS)
        errors.append(np.abs(ours - want))
    found = np.concatenate(errors)
    assert np.median(found) <= 0.6 * RESOLUTION
    assert np.quantile(found, 0.95) <= 2.0 * RESOLUTION
    assert (found > 10 * RESOLUTION).mean() < 0.02  # rays past corners
