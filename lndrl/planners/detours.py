"""How much longer than straight the way to the goal is, around what the laser sees.

A grid around the robot, its distances those of ways over eight neighbours. What is subtracted is
the same distance in an empty grid, so that a free way has no detour, and no direction is favoured.
What is not seen is taken to be free.
"""

from __future__ import annotations

import math

from lndrl.kernels import kernel

_MOST_SWEEPS = 24
_BLOCKED = 20.0  # times a free cell: one who starts in there finds its way out
_CLOSE = 3.0


@kernel()
def octile(rows, columns):
    """Cells of the shortest way over eight neighbours between cells that far apart."""
    most, least = max(abs(rows), abs(columns)), min(abs(rows), abs(columns))
    return most + (math.sqrt(2.0) - 1.0) * least


@kernel()
def stamp(points, cell, blocked, close, effort):
    """Write to ``effort`` (N, N) how many times a free cell each one counts.

    The robot is in the middle, x along rows. Cells whose middle is within ``blocked`` m of one of
    ``points`` (P, 2) cannot be driven, those within ``close`` m are avoided.
    """
    cells = effort.shape[0]
    middle = cells // 2
    effort[:] = 1.0
    reach = int(min(math.ceil(close / cell), cells))
    for k in range(points.shape[0]):
        x, y = points[k, 0] / cell + middle, points[k, 1] / cell + middle
        if not (0.0 <= x < cells and 0.0 <= y < cells):  # false for NaN
            continue
        row, column = int(x), int(y)
        for i in range(max(row - reach, 0), min(row + reach + 1, cells)):
            for j in range(max(column - reach, 0), min(column + reach + 1, effort.shape[1])):
                apart = math.hypot(i - x, j - y) * cell
                if apart < blocked:
                    effort[i, j] = _BLOCKED
                elif apart < close:
                    effort[i, j] = max(effort[i, j], _CLOSE)


@kernel()
def spread(effort, goal, cell, out):
    """Write to ``out`` (N, N) how many m longer than straight the way to ``goal`` (2,) is.

    ``effort`` (N, N) as ``stamp`` writes it. Beyond the grid everything is free. All zero where
    the goal is no number or farther than can be counted.
    """
    cells = min(out.shape[0], out.shape[1], effort.shape[0], effort.shape[1])
    out[:] = 0.0
    if not (abs(goal[0]) < 1e6 and abs(goal[1]) < 1e6) or cells < 2:
        return
    middle = cells // 2
    row, column = round(goal[0] / cell) + middle, round(goal[1] / cell) + middle
    for i in range(cells):
        for j in range(cells):
            edge = i == 0 or j == 0 or i == cells - 1 or j == cells - 1
            seed = edge or (i == row and j == column)
            out[i, j] = octile(i - row, j - column) if seed else math.inf
    diagonal = math.sqrt(2.0)
    for sweep in range(_MOST_SWEEPS):
        changed = False
        # Rows down and up, columns right and left in turn.
        down, right = 1 if sweep % 2 == 0 else -1, 1 if sweep // 2 % 2 == 0 else -1
        for a in range(cells):
            i = a if down > 0 else cells - 1 - a
            for b in range(cells):
                j = b if right > 0 else cells - 1 - b
                best = out[i, j]
                here = 0.5 * effort[i, j]
                up, beside = i - down, j - right
                if 0 <= up < cells:
                    best = min(best, out[up, j] + here + 0.5 * effort[up, j])
                    if 0 <= beside < cells:
                        best = min(
                            best, out[up, beside] + diagonal * (here + 0.5 * effort[up, beside])
                        )
                    other = j + right
                    if 0 <= other < cells:
                        best = min(
                            best, out[up, other] + diagonal * (here + 0.5 * effort[up, other])
                        )
                if 0 <= beside < cells:
                    best = min(best, out[i, beside] + here + 0.5 * effort[i, beside])
                if best < out[i, j] - 1e-9:
                    out[i, j] = best
                    changed = True
        if not changed and sweep >= 3:
            break
    for i in range(cells):
        for j in range(cells):
            out[i, j] = cell * max(out[i, j] - octile(i - row, j - column), 0.0)


@kernel()
def detour_at(detours, cell, x, y):
    """``detours`` (N, N) at ``x``, ``y`` m, between the middles of cells; at the edge beyond it."""
    cells = min(detours.shape[0], detours.shape[1])
    if cells < 2:
        return 0.0
    most = cells - 1.000001
    middle = cells // 2
    row, column = x / cell + middle, y / cell + middle
    row = min(max(row, 0.0), most) if row == row else 0.0
    column = min(max(column, 0.0), most) if column == column else 0.0
    i, j = int(row), int(column)
    a, b = row - i, column - j
    upper = (1.0 - b) * detours[i, j] + b * detours[i, j + 1]
    lower = (1.0 - b) * detours[i + 1, j] + b * detours[i + 1, j + 1]
    return (1.0 - a) * upper + a * lower


@kernel()
def way_on(detours, cell, goal, x, y):
    """The bearing (rad) in which the way to ``goal`` (2,) becomes shorter from ``x``, ``y`` m."""
    dx, dy = goal[0] - x, goal[1] - y
    distance = math.hypot(dx, dy)
    if detour_at(detours, cell, x, y) > 0.05 and distance > 0.0:
        by = 1.5 * cell
        more = detour_at(detours, cell, x + by, y) - detour_at(detours, cell, x - by, y)
        left = detour_at(detours, cell, x, y + by) - detour_at(detours, cell, x, y - by)
        dx, dy = dx / distance - more / (2.0 * by), dy / distance - left / (2.0 * by)
    return math.atan2(dy, dx)
