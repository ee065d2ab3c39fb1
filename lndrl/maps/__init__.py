"""Occupancy grids, distance fields and ray casting."""

from lndrl.maps.grid import OccupancyGrid, distance_field, grid_from_scenario
from lndrl.maps.raycast import clearance, raycast

__all__ = ["OccupancyGrid", "clearance", "distance_field", "grid_from_scenario", "raycast"]
