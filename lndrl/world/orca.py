"""Optimal reciprocal collision avoidance between agents of equal radius.

Half-planes and the three linear programs of van den Berg et al., "Reciprocal n-body collision
avoidance" (2011), with the names of RVO2. A half-plane is a row [px, py, dx, dy]: allowed
velocities lie left of the line through p with unit direction d. Those of walls (``orca_walls``)
come first and are never given up.
"""

from __future__ import annotations

import numpy as np

from lndrl.kernels import kernel

_EPSILON = 1e-5


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def orca_line(
    relative_x,
    relative_y,
    velocity_x,
    velocity_y,
    other_vx,
    other_vy,
    combined,
    horizon,
    period,
    side,
):
    """Half-plane (px, py, dx, dy) that one neighbour leaves to the agent.

    ``relative_*`` is neighbour minus agent (m), ``combined`` the sum of radii (m), ``horizon``
    the look-ahead (s), ``period`` the time in which an overlap is to be resolved (s). ``side``,
    -1 or 1 and the other one for the neighbour, is where to (along x) two go that nothing tells
    apart.
    """
    slip_x = velocity_x - other_vx
    slip_y = velocity_y - other_vy
    distance2 = relative_x * relative_x + relative_y * relative_y
    combined2 = combined * combined
    overlap = distance2 <= combined2
    inverse = 1.0 / period if overlap else 1.0 / horizon
    # Vector from the cut-off circle's centre to the relative velocity.
    wx = slip_x - inverse * relative_x
    wy = slip_y - inverse * relative_y
    along = wx * relative_x + wy * relative_y
    w2 = wx * wx + wy * wy
    if overlap or (along < 0.0 and along * along > combined2 * w2):
        length = np.sqrt(w2)
        if length > 1e-9:
            unit_x, unit_y = wx / length, wy / length
        else:
            unit_x, unit_y = side, 0.0  # any direction out of the exact centre, but not the same
        push = combined * inverse - length
        dx, dy = unit_y, -unit_x
        ux, uy = push * unit_x, push * unit_y
    else:
        leg = np.sqrt(distance2 - combined2)
        if relative_x * wy - relative_y * wx > 0.0:
            dx = (relative_x * leg - relative_y * combined) / distance2
            dy = (relative_x * combined + relative_y * leg) / distance2
        else:
            dx = -(relative_x * leg + relative_y * combined) / distance2
            dy = -(-relative_x * combined + relative_y * leg) / distance2
        dot = slip_x * dx + slip_y * dy
        ux, uy = dot * dx - slip_x, dot * dy - slip_y
    return velocity_x + 0.5 * ux, velocity_y + 0.5 * uy, dx, dy


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _linear_program_1(lines, index, radius, target_x, target_y, by_direction):
    px, py, dx, dy = lines[index, 0], lines[index, 1], lines[index, 2], lines[index, 3]
    dot = px * dx + py * dy
    discriminant = dot * dot + radius * radius - px * px - py * py
    if discriminant < 0.0:
        return False, 0.0, 0.0
    root = np.sqrt(discriminant)
    left = -dot - root
    right = -dot + root
    for i in range(index):
        denominator = dx * lines[i, 3] - dy * lines[i, 2]
        numerator = lines[i, 2] * (py - lines[i, 1]) - lines[i, 3] * (px - lines[i, 0])
        if abs(denominator) <= _EPSILON:
            if numerator < 0.0:
                return False, 0.0, 0.0
            continue
        t = numerator / denominator
        if denominator >= 0.0:
            right = min(right, t)
        else:
            left = max(left, t)
        if left > right:
            return False, 0.0, 0.0
    if by_direction:
        t = right if target_x * dx + target_y * dy > 0.0 else left
    else:
        t = min(max(dx * (target_x - px) + dy * (target_y - py), left), right)
    return True, px + t * dx, py + t * dy


@kernel(error_model="numpy", _nrt=False)
def linear_program_2(lines, count, radius, target_x, target_y, by_direction):
    """Velocity nearest to the target (or farthest along it) inside disc and half-planes.

    Returns (index of the first line that could not be met, or ``count``; x; y).
    """
    length2 = target_x * target_x + target_y * target_y
    if by_direction:
        x, y = target_x * radius, target_y * radius
    elif length2 > radius * radius:
        scale = radius / np.sqrt(length2)
        x, y = target_x * scale, target_y * scale
    else:
        x, y = target_x, target_y
    for i in range(count):
        violation = lines[i, 2] * (lines[i, 1] - y) - lines[i, 3] * (lines[i, 0] - x)
        if violation > 0.0:
            met, new_x, new_y = _linear_program_1(
                lines, i, radius, target_x, target_y, by_direction
            )
            if not met:
                return i, x, y
            x, y = new_x, new_y
    return count, x, y


@kernel(error_model="numpy", _nrt=False)
def linear_program_3(lines, count, firm, begin, radius, x, y, projected):
    """Velocity with the smallest worst violation when no velocity meets every half-plane.

    The first ``firm`` lines are met exactly; ``begin`` is the line that ``linear_program_2``
    failed on and (x, y) its velocity; ``projected`` (count, 4) is scratch.
    """
    for j in range(firm):
        for k in range(4):
            projected[j, k] = lines[j, k]
    worst = 0.0
    for i in range(begin, count):
        px, py, dx, dy = lines[i, 0], lines[i, 1], lines[i, 2], lines[i, 3]
        if dx * (py - y) - dy * (px - x) <= worst:
            continue
        kept = firm
        for j in range(firm, i):
            qx, qy, ex, ey = lines[j, 0], lines[j, 1], lines[j, 2], lines[j, 3]
            determinant = dx * ey - dy * ex
            if abs(determinant) <= _EPSILON:
                if dx * ex + dy * ey > 0.0:
                    continue
                projected[kept, 0] = 0.5 * (px + qx)
                projected[kept, 1] = 0.5 * (py + qy)
            else:
                t = (ex * (py - qy) - ey * (px - qx)) / determinant
                projected[kept, 0] = px + t * dx
                projected[kept, 1] = py + t * dy
            length = np.sqrt((ex - dx) ** 2 + (ey - dy) ** 2)
            projected[kept, 2] = (ex - dx) / length
            projected[kept, 3] = (ey - dy) / length
            kept += 1
        failed, new_x, new_y = linear_program_2(projected, kept, radius, -dy, dx, True)
        if failed == kept:  # otherwise rounding: the old velocity already lies on the line
            x, y = new_x, new_y
        worst = dx * (py - y) - dy * (px - x)
    return x, y


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def near_agents(agent, position, agents, reach, most, nearest, distance2):
    """Rows of up to ``most`` agents nearer than ``reach`` m, nearest first; returns how many.

    ``nearest`` (int64) gets the rows, ``distance2`` the squared distances; where they have room for
    fewer than ``most``, that is how many. Of two at the same distance the earlier row comes first.
    """
    most = min(most, len(nearest), len(distance2))
    agents = min(agents, len(position))
    if most < 1:
        return 0
    x, y = position[agent, 0], position[agent, 1]
    limit2 = reach * reach
    count = 0
    for other in range(agents):
        dx = position[other, 0] - x
        dy = position[other, 1] - y
        square = dx * dx + dy * dy
        if square >= limit2 or other == agent:
            continue
        slot = count
        if count == most:  # the farthest goes
            slot -= 1
        else:
            count += 1
        while slot > 0 and square < distance2[slot - 1]:
            distance2[slot] = distance2[slot - 1]
            nearest[slot] = nearest[slot - 1]
            slot -= 1
        distance2[slot] = square
        nearest[slot] = other
        if count == most:
            limit2 = distance2[most - 1]
    return count


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def orca_velocity(
    agent,
    position,
    velocity,
    agents,
    target_x,
    target_y,
    firm,
    neighbor_distance,
    max_neighbors,
    horizon,
    radius,
    max_speed,
    period,
    nearest,
    distance2,
    lines,
    projected,
):
    """New velocity (m/s) of ``agent`` among the first ``agents`` rows of position, velocity.

    ``target_*`` is the preferred velocity. The first ``firm`` rows of ``lines`` are half-planes
    of walls; ``lines`` and ``projected`` need room for them and for ``max_neighbors``, as do
    ``nearest`` (int64) and ``distance2`` (float64) for the latter.
    """
    found = near_agents(
        agent, position, agents, neighbor_distance, max_neighbors, nearest, distance2
    )
    found = min(found, min(len(lines), len(projected)) - firm)
    for k in range(found):
        other = nearest[k]
        px, py, dx, dy = orca_line(
            position[other, 0] - position[agent, 0],
            position[other, 1] - position[agent, 1],
            velocity[agent, 0],
            velocity[agent, 1],
            velocity[other, 0],
            velocity[other, 1],
            2.0 * radius,
            horizon,
            period,
            -1.0 if agent < other else 1.0,
        )
        lines[firm + k, 0] = px
        lines[firm + k, 1] = py
        lines[firm + k, 2] = dx
        lines[firm + k, 3] = dy
    count = firm + found
    failed, x, y = linear_program_2(lines, count, max_speed, target_x, target_y, False)
    if failed < count:
        x, y = linear_program_3(lines, count, firm, failed, max_speed, x, y, projected)
    return x, y
