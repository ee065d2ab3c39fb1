"""Occupancy grids, distance fields and ray casting."""

from lndrl.maps.grid import OccupancyGrid, distance_field, grid_from_scenario
from lndrl.maps.raycast import raycast

__all__ = ["OccupancyGrid", "distance_field", "grid_from_scenario", "raycast"]
