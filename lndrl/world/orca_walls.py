"""Walls for ORCA: closed outlines in tiles, and the half-planes that they leave to one agent.

The velocity obstacle of a line segment as in van den Berg et al., "Reciprocal n-body collision
avoidance" (2011), §5.3, with RVO2's rules where edges meet: legs of a convex corner never point
into its other edge, a concave corner has no leg, an edge that earlier half-planes cover adds none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.kernels import kernel

_EPSILON = 1e-5
_STRAIGHT = 1e-4  # rad
_TILE = 1.0  # m
# Columns of an edge: start, end, unit direction, that of the edge before and after; then whether
# its start and its end are convex corners, its length.
_X, _Y, _END_X, _END_Y, _DX, _DY = 0, 1, 2, 3, 4, 5
_BEFORE_X, _BEFORE_Y, _AFTER_X, _AFTER_Y, _CONVEX, _END_CONVEX, _LENGTH = 6, 7, 8, 9, 10, 11, 12
_COLUMNS = 13


class Walls(NamedTuple):
    """Edges of everything solid, and which of them can matter to an agent in each tile.

    ``edges`` (E, 13) float64, one row per edge, solid on its left (columns above); ``members``
    int32: rows of ``edges``, those of tile t from ``starts[t]`` to ``starts[t + 1]``; tile t is
    row * ``columns`` + column; (``left``, ``bottom``) (m) is the lower left corner of tile 0.
    Outside the tiles there are no walls.
    """

    edges: NDArray[np.float64]
    members: NDArray[np.int32]
    starts: NDArray[np.int32]
    rows: int
    columns: int
    left: float
    bottom: float

    @property
    def most(self) -> int:
        """Edges of the fullest tile."""
        return int(np.diff(self.starts).max(initial=0))


def build_walls(outlines: Sequence[NDArray[np.float64]], reach: float) -> Walls:
    """Index closed polygons ``(n, 2)`` (m), solid on the left of each edge, n >= 2.

    Obstacles run counter-clockwise, the inside of an outer wall clockwise; two corners make a
    wall without thickness. ``reach`` (m): farther edges are not looked at, as RVO2's
    horizon * max_speed + radius. Raises UserError for an outline with fewer than two corners or
    with a number that is not finite.
    """
    return index_edges(wall_edges(outlines), reach)


def wall_edges(outlines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Rows of ``Walls.edges`` for closed polygons; arguments and errors as in ``build_walls``.

    Corners that repeat their predecessor are dropped.
    """
    arrays = [np.asarray(outline, dtype=np.float64) for outline in outlines]
    for i, outline in enumerate(arrays):
        if outline.ndim != 2 or outline.shape[1:] != (2,) or not np.isfinite(outline).all():
            raise UserError(f"outline {i}: must be finite corners [x, y], one per row")
    # All outlines at once: a map of speckles has thousands of them.
    corners = np.concatenate([np.zeros((0, 2)), *arrays])
    owner = np.repeat(np.arange(len(arrays)), [len(outline) for outline in arrays])
    kept = np.hypot(*(corners - corners[_neighbours(owner)[0]]).T) > 1e-9
    corners, owner = corners[kept], owner[kept]
    counts = np.bincount(owner, minlength=len(arrays))
    if (counts < 2).any():
        i = int(np.argmax(counts < 2))
        raise UserError(f"outline {i}: needs at least two different corners")
    earlier, later = _neighbours(owner)
    ends = corners[later]
    length = np.hypot(*(ends - corners).T)
    unit = (ends - corners) / length[:, None]
    before, after = unit[earlier], unit[later]
    turn = before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0]
    # A straight joint is convex, and rounding must not make it concave.
    convex = (turn >= -_STRAIGHT) | (counts[owner] == 2)
    parts = [corners, ends, unit, before, after, convex, convex[later], length]
    return np.column_stack(parts).astype(np.float64)


def _neighbours(owner: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row before and row after each row in its closed polygon; ``owner`` numbers polygons."""
    first = np.searchsorted(owner, owner)
    last = np.searchsorted(owner, owner, side="right") - 1
    row = np.arange(len(owner))
    return np.where(row == first, last, row - 1), np.where(row == last, first, row + 1)


def index_edges(edges: NDArray[np.float64], reach: float) -> Walls:
    """Sort ``wall_edges`` into the tiles from where they can be within ``reach`` m."""
    if len(edges) == 0:
        none = np.zeros(0, dtype=np.int32)
        return Walls(edges, none, np.zeros(1, dtype=np.int32), 0, 0, 0.0, 0.0)
    corner = edges[:, :2].min(axis=0) - reach
    size = edges[:, :2].max(axis=0) + reach - corner
    columns, rows = (max(1, int(np.ceil(s / _TILE))) for s in size)
    far = reach + _TILE * np.sqrt(0.5) + 1e-6  # from a tile's middle
    boxes = tile_boxes(edges, far, corner, rows, columns)
    middles = corner + 0.5 * _TILE
    starts = np.zeros(rows * columns + 1, dtype=np.int32)
    members = np.zeros(0, dtype=np.int32)
    insert_edges(edges, boxes, middles, far, columns, starts[1:], members, False)  # how many first
    np.cumsum(starts, out=starts)
    members = np.zeros(starts[-1], dtype=np.int32)
    insert_edges(edges, boxes, middles, far, columns, starts[:-1].copy(), members, True)
    return Walls(edges, members, starts, rows, columns, float(corner[0]), float(corner[1]))


def tile_boxes(
    edges: NDArray[np.float64], far: float, corner: NDArray[np.float64], rows: int, columns: int
) -> NDArray[np.int64]:
    """Tiles that are worth a look for each edge, (E, 4): first column and row, last ones.

    Those whose middles lie in the edge's own box, ``far`` m larger; no other middle is so near.
    """
    ends = np.stack([edges[:, :2], edges[:, [_END_X, _END_Y]]])
    most = np.array([columns, rows]) - 1
    first = np.ceil((ends.min(axis=0) - far - corner) / _TILE - 0.5 - 1e-6).clip(0, most)
    last = np.floor((ends.max(axis=0) + far - corner) / _TILE - 0.5 + 1e-6).clip(0, most)
    return np.hstack([first, last]).astype(np.int64)


@kernel(error_model="numpy", _nrt=False)
def insert_edges(edges, boxes, middles, far, columns, places, members, write):
    """Count each tile's edges into ``places``, or ``write`` them to ``members`` from there on."""
    for e in range(len(edges)):
        for row in range(boxes[e, 1], boxes[e, 3] + 1):
            y = middles[1] + _TILE * row - edges[e, _Y]
            for column in range(boxes[e, 0], boxes[e, 2] + 1):
                x = middles[0] + _TILE * column - edges[e, _X]
                along = x * edges[e, _DX] + y * edges[e, _DY]
                along = min(max(along, 0.0), edges[e, _LENGTH])
                apart_x, apart_y = x - along * edges[e, _DX], y - along * edges[e, _DY]
                if np.sqrt(apart_x * apart_x + apart_y * apart_y) <= far:
                    tile = row * columns + column
                    if write:
                        members[places[tile]] = e
                    places[tile] += 1


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def near_edges(x, y, edges, members, begin, end, reach, nearest, distance2):
    """Edges within ``reach`` m that the point faces, nearest first, into ``nearest`` (int64).

    Looks at ``members[begin:end]``; of two equally near the earlier comes first. ``distance2``
    (float64) gets the squared distances; returns how many, as many as there is room for: all, with
    room for ``walls.most``.
    """
    count = 0
    most = min(len(nearest), len(distance2))
    for k in range(begin, end):
        e = np.int64(members[k])
        px = x - edges[e, _X]
        py = y - edges[e, _Y]
        side = edges[e, _DX] * py - edges[e, _DY] * px
        if side >= 0.0 or side <= -reach:  # seen from behind, or too far from its line
            continue
        along = edges[e, _DX] * px + edges[e, _DY] * py
        # From the corner itself where that is nearest, so that edges which share it tie exactly.
        square = side * side
        if along < 0.0:
            square = px * px + py * py
        elif along > edges[e, _LENGTH]:
            px = x - edges[e, _END_X]
            py = y - edges[e, _END_Y]
            square = px * px + py * py
        if square >= reach * reach:
            continue
        if count >= most:
            break
        slot = count
        while slot > 0 and square < distance2[slot - 1]:
            distance2[slot] = distance2[slot - 1]
            nearest[slot] = nearest[slot - 1]
            slot -= 1
        distance2[slot] = square
        nearest[slot] = e
        count += 1
    return count


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _covered(lines, count, ax, ay, bx, by, margin):
    """Whether one half-plane already keeps ``margin`` to both scaled corners."""
    for j in range(count):
        px, py, dx, dy = lines[j, 0], lines[j, 1], lines[j, 2], lines[j, 3]
        if (ax - px) * dy - (ay - py) * dx - margin < -_EPSILON:
            continue
        if (bx - px) * dy - (by - py) * dx - margin >= -_EPSILON:
            return True
    return False


@njit(inline="always")
def _put(lines, count, px, py, dx, dy):
    lines[count, 0] = px
    lines[count, 1] = py
    lines[count, 2] = dx
    lines[count, 3] = dy
    return count + 1


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def tile_of(x, y, rows, columns, left, bottom):
    """Number of the tile that holds the point, -1 outside (arguments as in ``Walls``)."""
    column = np.floor((x - left) * (1.0 / _TILE))
    row = np.floor((y - bottom) * (1.0 / _TILE))
    # Before they become integers: what is not finite, or does not fit one, lies outside.
    if not (row >= 0.0 and column >= 0.0 and row < rows and column < columns):
        return -1
    return int(row) * columns + int(column)


@kernel(error_model="numpy", _nrt=False)
def wall_lines(
    x,
    y,
    vx,
    vy,
    edges,
    members,
    begin,
    end,
    radius,
    horizon,
    max_speed,
    nearest,
    distance2,
    lines,
):
    """Half-planes [px, py, dx, dy] that walls leave to an agent at (x, y) with velocity (vx, vy).

    Metres and m/s; ``members[begin:end]`` are the edges of the agent's tile, ``radius`` its own,
    ``horizon`` the look-ahead (s). Fills ``lines`` from row 0 and returns how many; ``nearest``,
    ``distance2`` are scratch. With room for ``walls.most`` in each, none is left out.
    """
    reach = horizon * max_speed + radius
    found = near_edges(x, y, edges, members, begin, end, reach, nearest, distance2)
    found = min(found, len(lines))
    inverse = 1.0 / horizon
    count = np.int64(0)  # with a plain 0 numba would compile what is called here twice
    for k in range(found):
        e = nearest[k]
        ax = (edges[e, _X] - x) * inverse
        ay = (edges[e, _Y] - y) * inverse
        bx = (edges[e, _END_X] - x) * inverse
        by = (edges[e, _END_Y] - y) * inverse
        if not _covered(lines, count, ax, ay, bx, by, radius * inverse):
            count = _edge_line(edges, e, x, y, vx, vy, radius, inverse, lines, count)
    return count


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _edge_line(edges, e, x, y, vx, vy, radius, inverse, lines, count):
    """Append the half-plane of one edge where it has one; returns the new count."""
    ax, ay = edges[e, _X] - x, edges[e, _Y] - y
    bx, by = edges[e, _END_X] - x, edges[e, _END_Y] - y
    dx, dy = edges[e, _DX], edges[e, _DY]
    along = -(ax * dx + ay * dy)
    side = ax * dy - ay * dx
    a2, b2, radius2 = ax * ax + ay * ay, bx * bx + by * by, radius * radius
    before, after = along < 0.0, along > edges[e, _LENGTH]
    oblique = side * side <= radius2
    convex_a, convex_b = edges[e, _CONVEX] != 0.0, edges[e, _END_CONVEX] != 0.0
    # In touch: nothing towards the wall.
    if before and a2 <= radius2:
        if convex_a:
            length = np.sqrt(a2)
            count = _put(lines, count, 0.0, 0.0, -ay / length, ax / length)
        return count
    if after and b2 <= radius2:
        # Where the next edge is seen as well, it is the one to say so.
        if convex_b and bx * edges[e, _AFTER_Y] - by * edges[e, _AFTER_X] >= 0.0:
            length = np.sqrt(b2)
            count = _put(lines, count, 0.0, 0.0, -by / length, bx / length)
        return count
    if not before and not after and oblique:
        return _put(lines, count, 0.0, 0.0, -dx, -dy)
    # Seen so obliquely that one corner hides the rest: that corner alone.
    single = oblique
    before_x, before_y, after_x, after_y = (
        edges[e, _BEFORE_X],
        edges[e, _BEFORE_Y],
        edges[e, _AFTER_X],
        edges[e, _AFTER_Y],
    )
    if single and before:
        if not convex_a:
            return count
        bx, by, b2, convex_b = ax, ay, a2, convex_a
        after_x, after_y = dx, dy
    elif single:
        if not convex_b:
            return count
        ax, ay, a2, convex_a = bx, by, b2, convex_b
        before_x, before_y = dx, dy
    # Legs are tangents to the discs around the corners; a concave corner lengthens the edge.
    left_x, left_y, right_x, right_y = -dx, -dy, dx, dy
    left_foreign, right_foreign = False, False
    if convex_a:
        leg = np.sqrt(a2 - radius2)
        left_x, left_y = (ax * leg - ay * radius) / a2, (ax * radius + ay * leg) / a2
        if left_y * before_x - left_x * before_y >= 0.0:
            left_x, left_y, left_foreign = -before_x, -before_y, True
    if convex_b:
        leg = np.sqrt(b2 - radius2)
        right_x, right_y = (bx * leg + by * radius) / b2, (by * leg - bx * radius) / b2
        if right_x * after_y - right_y * after_x <= 0.0:
            right_x, right_y, right_foreign = after_x, after_y, True
    return _nearest_border(
        vx - ax * inverse,
        vy - ay * inverse,
        vx - bx * inverse,
        vy - by * inverse,
        vx,
        vy,
        dx,
        dy,
        edges[e, _LENGTH] * inverse,
        single,
        left_x,
        left_y,
        left_foreign,
        right_x,
        right_y,
        right_foreign,
        radius * inverse,
        lines,
        count,
    )


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _nearest_border(
    px,
    py,
    qx,
    qy,
    vx,
    vy,
    dx,
    dy,
    width,
    single,
    left_x,
    left_y,
    left_foreign,
    right_x,
    right_y,
    right_foreign,
    radius,
    lines,
    count,
):
    """Append the half-plane at the velocity obstacle's border point nearest to the velocity.

    (px, py) and (qx, qy) lead from the cut-off's left and right end to the velocity (vx, vy);
    ``width`` is the cut-off's length, ``radius`` the obstacle's in velocities.
    """
    t = px * dx + py * dy
    t_left = px * left_x + py * left_y
    t_right = qx * right_x + qy * right_y
    before = not single and t < 0.0
    after = not single and t > width
    if (before and t_left < 0.0) or (single and t_left < 0.0 and t_right < 0.0):
        length = np.sqrt(px * px + py * py)
        ux, uy = px / length, py / length
        return _put(lines, count, vx - px + radius * ux, vy - py + radius * uy, uy, -ux)
    if after and t_right < 0.0:
        length = np.sqrt(qx * qx + qy * qy)
        ux, uy = qx / length, qy / length
        return _put(lines, count, vx - qx + radius * ux, vy - qy + radius * uy, uy, -ux)
    cut_off = left = right = np.inf
    if not (before or after or single):
        cut_off = (px * dy - py * dx) ** 2
    if t_left >= 0.0:
        left = (px * left_y - py * left_x) ** 2
    if t_right >= 0.0:
        right = (qx * right_y - qy * right_x) ** 2
    if cut_off <= left and cut_off <= right:
        return _put(lines, count, vx - px + radius * dy, vy - py - radius * dx, -dx, -dy)
    if left <= right:
        if left_foreign:
            return count
        return _put(
            lines, count, vx - px - radius * left_y, vy - py + radius * left_x, left_x, left_y
        )
    if right_foreign:
        return count
    return _put(
        lines, count, vx - qx + radius * right_y, vy - qy - radius * right_x, -right_x, -right_y
    )
