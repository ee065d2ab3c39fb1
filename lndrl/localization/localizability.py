"""The localizability field of a map for the configured laser and filter, built once a process."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization.amcl import amcl_beam_stride
from lndrl.maps.grid import OccupancyGrid
from lndrl.maps.localizability import LocalizabilityField, Sensor, grid_hash

_KEPT = 16  # fields; a random scenario has a map for every layout
_fields: OrderedDict[tuple[str, Sensor], LocalizabilityField] = OrderedDict()


def sensor_of(laser: LaserConfig, localization: LocalizationConfig) -> Sensor:
    """What the filter makes of the laser.

    The deviation is the filter's ``laser_sigma_hit``, not the laser's: what a scan tells is lost
    again as far as the filter does not believe it, and its 0.2 m in place of the laser's 0.02 m
    decide how tight a cloud becomes. It does not believe more than ``laser_likelihood_max_dist``,
    either: beyond it nothing tells one position from another.
    """
    stride = amcl_beam_stride(laser, localization)
    return Sensor(
        beams=(laser.beams + stride - 1) // stride,
        field_of_view=laser.field_of_view,
        range_max=localization.max_range(laser.range_max),
        sigma=localization.laser_sigma_hit,
        farthest=localization.laser_likelihood_max_dist,
    )


def localizability_field(
    grid: OccupancyGrid,
    cells: NDArray[np.uint8],
    laser: LaserConfig,
    localization: LocalizationConfig,
) -> LocalizabilityField:
    """The field of ``grid`` (``cells``: its clearance), from memory where it was built before."""
    sensor = sensor_of(laser, localization)
    key = (grid_hash(grid), sensor)
    if key not in _fields:
        _fields[key] = LocalizabilityField.build(grid, cells, sensor)
        if len(_fields) > _KEPT:
            _fields.popitem(last=False)
    _fields.move_to_end(key)
    return _fields[key]
