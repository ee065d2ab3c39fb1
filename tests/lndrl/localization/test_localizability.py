"""The field for a configured laser and filter: whose numbers count, and what is kept."""

from __future__ import annotations

import numpy as np

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.localizability import localizability_field, sensor_of
from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.raycast import clearance


def test_the_filters_numbers_count() -> None:
    sensor = sensor_of(LaserConfig(), LocalizationConfig())
    assert sensor == (60, np.pi, 12.0, 0.2, 2.0)
    best = sensor_of(LaserConfig(), LocalizationConfig.model_validate("best"))
    assert best.sigma == 0.1
    near = LocalizationConfig(laser_max_range=8.0, laser_likelihood_max_dist=1.0)
    assert sensor_of(LaserConfig(beams=90), near)[::2] == (90, 8.0, 1.0)


def test_a_field_is_built_once_for_a_map_and_a_sensor() -> None:
    occupied = np.zeros((50, 50), bool)
    occupied[:2] = True

    def field(occupied, **changes):
        grid = OccupancyGrid(occupied.copy(), 0.1)
        cells = clearance(distance_field(occupied, 0.1), 0.1)
        return localizability_field(grid, cells, LaserConfig(), LocalizationConfig(**changes))

    first = field(occupied)
    assert field(occupied) is first
    assert field(occupied, laser_sigma_hit=0.1) is not first
    other = occupied.copy()
    other[40, 40] = True
    assert field(other).map_hash != first.map_hash
    assert field(occupied) is first
