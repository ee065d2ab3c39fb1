"""Occupancy grids and distance fields.

What is compiled is imported where it lies, such as ``lndrl.maps.raycast``: who reads a map need not
wait for the compiler.
"""

from lndrl.maps.grid import OccupancyGrid, distance_field, grid_from_scenario

__all__ = ["OccupancyGrid", "distance_field", "grid_from_scenario"]
