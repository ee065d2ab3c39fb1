"""From a map to the worth of a beam's end: distances to obstacles, factors of sensor models."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from lndrl.config import LocalizationConfig
from lndrl.maps.grid import OccupancyGrid, distance_field

_LEAST = 1e-30  # keeps the logarithm finite where z_rand is 0


def obstacle_distance(grid: OccupancyGrid, config: LocalizationConfig) -> NDArray[np.float64]:
    """Metres from each cell to what counts as the obstacle, ``(height, width)``, capped.

    ``config.laser_field`` chooses: ``solid`` is ROS's, to the nearest occupied cell, so zero
    anywhere inside an obstacle; ``boundaries`` to the nearest occupied cell that has a free
    neighbour (4-neighbours), so it grows again inside thick obstacles and pulls no particle into
    them; ``surfaces`` to the edge between free and occupied cells, from either side: where an exact
    laser really ends. At most ``laser_likelihood_max_dist``, which is also the value of a map
    without obstacles.
    """
    # Unknown cells stop the simulated laser, but no map says that something stands there.
    occupied, resolution = grid.mapped, grid.resolution
    farthest = config.laser_likelihood_max_dist
    if not occupied.any():
        return np.full(occupied.shape, farthest)
    if config.laser_field == "boundaries":
        # What lies off the map counts as solid: its border is no wall that a beam could end on.
        occupied = occupied & ~binary_erosion(occupied, border_value=1)
        if not occupied.any():
            return np.full(occupied.shape, farthest)
    distance = distance_field(occupied, resolution).astype(np.float64)
    if config.laser_field == "surfaces":
        # Centre to centre on both sides; the edge lies half a cell before the other side's centre.
        inside = distance_field(~occupied, resolution)
        distance = np.maximum(np.maximum(distance, inside) - 0.5 * resolution, 0.0)
    result: NDArray[np.float64] = np.minimum(distance, farthest)
    return result


def beam_factor(
    distance: NDArray[np.float64], config: LocalizationConfig, range_max: float
) -> NDArray[np.float64]:
    """Table value of a beam that ends ``distance`` m from an obstacle; falls with distance.

    ``range_max``: ``config.max_range`` of the laser (m).

    ``pz^3`` for the models that add beams, ``laser_likelihood_exponent * log pz`` for
    ``likelihood_field_prob``, which multiplies them.
    """
    hit = config.laser_z_hit * np.exp(-0.5 * (distance / config.laser_sigma_hit) ** 2)
    p = hit + config.laser_z_rand / range_max
    if config.laser_model_type == "likelihood_field_prob":
        result: NDArray[np.float64] = config.laser_likelihood_exponent * np.log(
            np.maximum(p, _LEAST)
        )
        return result
    cubed: NDArray[np.float64] = p**3
    return cubed
