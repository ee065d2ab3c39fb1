"""Does the robot touch a wall or a leg? Exact distances from its disc to outlines and leg discs.

The walls are the place's outlines, not its cells. Only the two legs of a pedestrian are solid, as
in the group's simulator (parameters §4.1). The tests hold this against pymunk.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from lndrl.kernels import kernel
from lndrl.world.orca_walls import tile_of

Hit = Literal["", "wall", "pedestrian"]
HITS: tuple[Hit, Hit, Hit] = ("", "wall", "pedestrian")
"""What the numbers that ``contact`` returns mean."""
NOTHING, WALL, PEDESTRIAN = range(3)


@kernel(_nrt=False)
def wall_gap(x, y, walls):
    """Metres from a point to the nearest edge of ``walls`` (``Walls``) within their reach."""
    nearest2 = np.inf
    tile = tile_of(x, y, walls.rows, walls.columns, walls.left, walls.bottom)
    if tile < 0:
        return nearest2
    edges = walls.edges
    for m in range(walls.starts[tile], walls.starts[tile + 1]):
        i = walls.members[m]
        along_x = edges[i, 2] - edges[i, 0]
        along_y = edges[i, 3] - edges[i, 1]
        from_x = x - edges[i, 0]
        from_y = y - edges[i, 1]
        share = (from_x * along_x + from_y * along_y) / (along_x * along_x + along_y * along_y)
        share = min(max(share, 0.0), 1.0)
        dx = from_x - share * along_x
        dy = from_y - share * along_y
        nearest2 = min(nearest2, dx * dx + dy * dy)
    return np.sqrt(nearest2)


@kernel(_nrt=False)
def contact(pose, legs, walls, distance, inverse_resolution, robot_radius, leg_radius):
    """What the robot's disc at ``pose`` touches: NOTHING, WALL or PEDESTRIAN.

    ``legs`` (L, 2) centres (m); ``walls`` the outlines as ``Walls`` with a reach of
    ``robot_radius`` or more; ``distance`` the map's field (m), 0 inside of solids. Off the grid is
    a wall. Where it touches both, the one it overlaps more.
    """
    overlap = -1.0
    hit = NOTHING
    reach = robot_radius + leg_radius
    for i in range(len(legs)):
        dx = legs[i, 0] - pose[0]
        dy = legs[i, 1] - pose[1]
        gap2 = dx * dx + dy * dy
        if gap2 <= reach * reach:
            depth = reach - np.sqrt(gap2)
            if depth > overlap:
                overlap = depth
                hit = PEDESTRIAN
    rows, columns = distance.shape
    column = np.floor(pose[0] * inverse_resolution)
    row = np.floor(pose[1] * inverse_resolution)
    if not (0.0 <= row < rows and 0.0 <= column < columns):
        return WALL
    depth = robot_radius - wall_gap(pose[0], pose[1], walls)
    if distance[int(row), int(column)] == 0.0:
        # The centre itself is inside something solid, where outlines are only its border.
        depth = 2.0 * robot_radius - max(depth, 0.0)
    if depth >= 0.0 and depth > overlap:
        hit = WALL
    return hit
