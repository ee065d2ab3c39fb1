"""Two actions in sequence, rolled out exactly along arcs, and what each pair would cost.

The arcs in the robot frame depend on the action table alone and are computed once; a decision only
measures them against goal, walls and people. Pairs whose cost without walls and people is above
the best so far are never measured.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.kernels import kernel
from lndrl.planners.detours import detour_at, spread, stamp, way_on
from lndrl.world.odometry import Limits, poses_along, velocities

Floats = NDArray[np.float64]

TOUCHED = 0.3
"""Share of the price of touching that is due at once where the margin is not kept."""


class Rollouts(NamedTuple):
    """Every pair of A actions, sampled in time; made once by ``make_rollouts``, never changed.

    ``first`` (A, S, 2) and ``second`` (A, A, T, 2): positions (m, robot frame) at
    ``first_times`` (S,) and ``second_times`` (T,), s from now; ``end`` (A, A, 3): the last pose.
    ``price`` (A, A): what the turning of a pair costs.
    """

    first: Floats
    second: Floats
    end: Floats
    first_times: Floats
    second_times: Floats
    price: Floats


class Prices(NamedTuple):
    """What kernels weigh pairs with; lengths (m) are clearances from the robot's edge.

    Within ``arrive`` m of the goal a way ends, and each s that is left earns ``arrive_gain``.
    ``cell``, ``blocked`` and ``close`` (m) are those of ``detours.stamp``; ``unseen`` is the price
    of an end that none of the walls in sight is seen from, ``sight`` (m) how far the laser sees.
    """

    goal: float
    heading: float
    wall: float
    wall_reach: float
    person: float
    person_reach: float
    touch: float
    touch_fade: float
    wall_margin: float
    person_margin: float
    robot_radius: float
    person_radius: float
    arrive: float
    arrive_gain: float
    cell: float
    blocked: float
    close: float
    unseen: float
    sight: float


def arc_poses(actions: Floats, times: Floats) -> Floats:
    """Poses (A, T, 3) of ``actions`` (A, 2), m/s and rad/s, at ``times`` (T,) s, from the origin.

    Exact: v / w (sin wt, 1 - cos wt), written so that small w lose nothing.
    """
    v, w = actions[:, :1], actions[:, 1:]
    turned = w * times
    half = 0.5 * turned
    chord = v * times * np.sinc(half / np.pi)
    return np.stack((chord * np.cos(half), chord * np.sin(half), turned), axis=2)


def make_rollouts(actions: Floats, first: Floats, second: Floats, price: Floats) -> Rollouts:
    """Rollouts of every pair of ``actions`` (A, 2).

    ``first`` (S,): times (s) at which the first arc is sampled, its end last; ``second`` (T,):
    times from there. ``price`` (A, A) is kept as it is.
    """
    before, after = arc_poses(actions, first), arc_poses(actions, second)
    return _joined(before, after[None], first, second, price)


def limited_rollouts(
    actions: Floats,
    first: Floats,
    second: Floats,
    price: Floats,
    start: Floats,
    limits: Limits,
    tick: float,
) -> Rollouts:
    """As ``make_rollouts``, of a robot that drives ``start`` (2,), m/s and rad/s, as it begins.

    Its velocities follow the actions within ``limits``, ``tick`` (s) by tick.
    """
    ticks = max(1, round(first[-1] / tick))
    speeds = velocities(start, actions, limits, tick, ticks)
    before = poses_along(speeds, tick, first)
    count = len(actions)
    later = max(1, round(second[-1] / tick))
    begun = np.repeat(speeds[:, -1], count, axis=0)
    speeds = velocities(begun, np.tile(actions, (count, 1)), limits, tick, later)
    after = poses_along(speeds, tick, second).reshape(count, count, len(second), 3)
    return _joined(before, after, first, second, price)


def _joined(
    before: Floats, after: Floats, first: Floats, second: Floats, price: Floats
) -> Rollouts:
    """Rollouts of first arcs (A, S, 3) and of second ones, (1 or A, A, T, 3) from their ends."""
    turn = before[:, -1]
    cosine, sine = (f(turn[:, 2])[:, None, None] for f in (np.cos, np.sin))
    x = turn[:, None, None, 0] + cosine * after[..., 0] - sine * after[..., 1]
    y = turn[:, None, None, 1] + sine * after[..., 0] + cosine * after[..., 1]
    yaw = turn[:, None, None, 2] + after[..., 2]
    poses = np.stack((x, y, yaw), axis=-1)
    return Rollouts(
        np.ascontiguousarray(before[..., :2]),
        np.ascontiguousarray(poses[..., :2]),
        np.ascontiguousarray(poses[:, :, -1]),
        first.copy(),
        first[-1] + second,
        price.copy(),
    )


@kernel()
def near_points(scan, directions, scale, reach, spacing, people, count, person_reach, out):
    """Write echoes that are walls within ``reach`` m to ``out`` (P, 2); returns how many.

    ``scan`` (beams,) counts of ``scale`` m, ``directions`` (beams, 2). Left out are beams without
    an echo, those that neither neighbour bears out (the sensor makes up one in a hundred), those
    within ``person_reach`` m of one of the ``count`` ``people`` (M, 4), and those nearer than
    ``spacing`` m to the last that was kept.
    """
    beams = min(scan.shape[0], directions.shape[0])
    count = min(count, people.shape[0])
    kept = 0
    for k in range(beams):
        distance = scan[k] * scale
        if distance > reach or scan[k] == 65535:
            continue
        before = abs(scan[max(k - 1, 0)] * scale - distance) if k > 0 else np.inf
        after = abs(scan[min(k + 1, beams - 1)] * scale - distance) if k + 1 < beams else np.inf
        if min(before, after) > 0.2:
            continue
        x, y = distance * directions[k, 0], distance * directions[k, 1]
        hidden = False
        for m in range(count):
            dx, dy = people[m, 0] - x, people[m, 1] - y
            hidden = hidden or dx * dx + dy * dy < person_reach * person_reach
        if hidden:
            continue
        if kept > 0:
            dx, dy = out[kept - 1, 0] - x, out[kept - 1, 1] - y
            if dx * dx + dy * dy < spacing * spacing:
                continue
        if kept == out.shape[0]:
            break
        out[kept, 0], out[kept, 1] = x, y
        kept += 1
    return kept


@kernel()
def spread_out(points, out):
    """Copy ``points`` (P, 2) to ``out`` (F, 2), of too many evenly some; returns how many."""
    kept = min(points.shape[0], out.shape[0])
    for k in range(kept):
        out[k] = points[k * points.shape[0] // kept]
    return kept


@kernel()
def keep_near(points, reach):
    """Move those of ``points`` (P, 2) within ``reach`` m to the front; returns how many."""
    kept = 0
    for k in range(points.shape[0]):
        if points[k, 0] * points[k, 0] + points[k, 1] * points[k, 1] <= reach * reach:
            points[kept, 0], points[kept, 1] = points[k, 0], points[k, 1]
            kept += 1
    return kept


@kernel()
def measure(path, times, points, people, prices, nearest_wall, nearest_person, touch, limit):
    """How near ``path`` (T, 2), m at ``times`` (T,) s, comes to walls and people.

    ``points`` (P, 2) stand, ``people`` (M, 4) walk on as they do. Goes on from the clearances (m)
    and the price of touching of what was driven before; returns the three, and what they cost.
    Stops as soon as that is above ``limit``.
    """
    cost = clearance_cost(nearest_wall, nearest_person, touch, prices)
    for k in range(path.shape[0]):
        x, y = path[k, 0], path[k, 1]
        wall = np.inf
        for m in range(points.shape[0]):
            dx, dy = points[m, 0] - x, points[m, 1] - y
            wall = min(wall, dx * dx + dy * dy)
        person = np.inf
        for m in range(people.shape[0]):
            dx = people[m, 0] + times[k] * people[m, 2] - x
            dy = people[m, 1] + times[k] * people[m, 3] - y
            squared = dx * dx + dy * dy
            if squared < person:  # false for NaN
                person = squared
        wall = math.sqrt(wall) - prices.robot_radius
        person = math.sqrt(person) - prices.robot_radius - prices.person_radius
        depth = max(depth_of(wall, prices.wall_margin), depth_of(person, prices.person_margin))
        if depth > 0.0:
            touch = max(touch, prices.touch * depth * math.exp(-times[k] / prices.touch_fade))
        nearest_wall = min(nearest_wall, wall)
        nearest_person = min(nearest_person, person)
        cost = clearance_cost(nearest_wall, nearest_person, touch, prices)
        if cost >= limit:
            break
    return nearest_wall, nearest_person, touch, cost


@kernel()
def depth_of(clearance, margin):
    """How bad a ``clearance`` (m) below ``margin`` is: from TOUCHED there to 1 at none; else 0."""
    if not clearance < margin:
        return 0.0
    return TOUCHED + (1.0 - TOUCHED) * min(1.0 - clearance / margin, 1.0) if margin > 0.0 else 1.0


@kernel()
def clearance_cost(wall, person, touch, prices):
    """What the least clearances (m) and the price of touching come to."""
    cost = touch
    if wall < prices.wall_reach:
        cost += prices.wall * (1.0 - wall / prices.wall_reach)
    if person < prices.person_reach:
        cost += prices.person * (1.0 - person / prices.person_reach)
    return cost


@kernel()
def out_of_view(features, x, y, yaw, sight):
    """Share of ``features`` (F, 2) behind the pose or farther than ``sight`` m from it."""
    if features.shape[0] == 0:
        return 0.0
    cosine, sine = math.cos(yaw), math.sin(yaw)
    seen = 0
    for k in range(features.shape[0]):
        dx, dy = features[k, 0] - x, features[k, 1] - y
        if dx * cosine + dy * sine > 0.0 and dx * dx + dy * dy < sight * sight:
            seen += 1
    return 1.0 - seen / features.shape[0]


@kernel()
def arrival(path, goal, arrive):
    """Index of the first of ``path`` (T, 2) within ``arrive`` m of ``goal`` (2,), else T."""
    for k in range(path.shape[0]):
        dx, dy = goal[0] - path[k, 0], goal[1] - path[k, 1]
        if dx * dx + dy * dy < arrive * arrive:
            return k
    return path.shape[0]


@kernel()
def goal_costs(rollouts, prices, goal, detours, features, turning, start, i, base, ends):
    """Write what pairs that begin with action ``i`` cost but for clearances to ``base`` (A,).

    ``ends`` (A,): how many samples of the second arc are driven. ``goal`` (2,) m in the robot
    frame, ``detours`` (N, N) m longer than straight, or (1, 1) for none; ``features`` (F, 2) m
    should stay in view; ``turning`` is a factor on the price of turning, ``start`` the price of
    beginning with ``i``. Returns how many samples of the first arc are driven, and the least cost.
    """
    times = rollouts.second_times
    horizon = times[-1]
    farthest = prices.arrive
    for j in range(base.shape[0]):
        farthest = max(
            farthest, prices.arrive + math.hypot(rollouts.end[i, j, 0], rollouts.end[i, j, 1])
        )
    near = goal[0] * goal[0] + goal[1] * goal[1] < farthest * farthest
    before = rollouts.first.shape[1]
    if near:
        before = arrival(rollouts.first[i], goal, prices.arrive)
    least = np.inf
    for j in range(base.shape[0]):
        ends[j] = times.shape[0]
        if before < rollouts.first.shape[1]:
            ends[j] = 0
            base[j] = prices.arrive_gain * (rollouts.first_times[before] - horizon)
            base[j] += prices.goal * prices.arrive + turning * rollouts.price[i].min() + start
            continue
        if near:
            ends[j] = arrival(rollouts.second[i, j], goal, prices.arrive)
        base[j] = turning * rollouts.price[i, j] + start
        if ends[j] < times.shape[0]:
            base[j] += prices.arrive_gain * (times[ends[j]] - horizon)
            base[j] += prices.goal * prices.arrive
            ends[j] += 1
        else:
            x, y, yaw = rollouts.end[i, j]
            past = way_on(detours, prices.cell, goal, x, y) - yaw
            past -= 2.0 * math.pi * math.floor(past / (2.0 * math.pi) + 0.5)
            distance = math.hypot(goal[0] - x, goal[1] - y)
            distance += detour_at(detours, prices.cell, x, y)
            base[j] += prices.goal * distance + prices.heading * abs(past)
            if prices.unseen > 0.0:
                base[j] += prices.unseen * out_of_view(features, x, y, yaw, prices.sight)
        least = min(least, base[j])
    if before < rollouts.first.shape[1]:
        return before + 1, base[0]
    return before, least


@kernel()
def first_costs(
    rollouts, prices, goal, detours, features, points, people, turning, start, every, base, ends,
    out,
):  # fmt: skip
    """Write to ``out`` (A,) the cost of the cheapest pair that begins with each action.

    ``goal`` (2,), ``points`` (P, 2) m and ``people`` (M, 4) m and m/s in the robot frame;
    ``detours`` (N, N), ``features`` (F, 2), ``turning`` and ``start`` (A,) as in ``goal_costs``;
    ``base``, ``ends`` (A,) working memory. Unless ``every``, pairs are only followed until they are
    dearer than the cheapest of all: the least entry is exact, others are at least the least.
    Infinite where no cost is a number.
    """
    best = np.inf
    for i in range(min(out.shape[0], start.shape[0])):
        cheapest = np.inf if every else best
        out[i] = np.inf
        before, least = goal_costs(
            rollouts, prices, goal, detours, features, turning, start[i], i, base, ends
        )
        if not least < cheapest:
            continue
        wall, person, touch, cost = measure(
            rollouts.first[i, :before], rollouts.first_times, points, people, prices,
            np.inf, np.inf, 0.0, cheapest - least,
        )  # fmt: skip
        while True:
            j = np.argmin(base)
            if not base[j] + cost < cheapest:
                break
            after = measure(
                rollouts.second[i, j, : ends[j]], rollouts.second_times, points, people, prices,
                wall, person, touch, cheapest - base[j],
            )[3]  # fmt: skip
            if base[j] + after < cheapest:
                cheapest = base[j] + after
                out[i] = cheapest
            base[j] = np.inf
        best = min(best, out[i])


@kernel()
def decide(
    scans, directions, scale, sight, reach, spacing, pedestrians, counts, person_reach, goals,
    rollouts, prices, turning, start, every, points, base, ends, effort, detours,
    features, out,
):  # fmt: skip
    """``first_costs`` of many observations, rows of ``out`` (B, A); each row for itself.

    ``scans`` (B, beams) are the newest, ``turning`` (B,), ``start`` (B, A); ``points`` (beams, 2),
    ``base`` and ``ends`` (A,) working memory; the rest as in ``near_points`` and ``first_costs``.
    """
    rows = min(scans.shape[0], pedestrians.shape[0], counts.shape[0], goals.shape[0], out.shape[0])
    rows = min(rows, turning.shape[0], start.shape[0])
    for row in range(rows):
        count = min(np.int64(counts[row]), pedestrians.shape[1])
        people = pedestrians[row, :count].astype(np.float64)
        kept = near_points(
            scans[row], directions, scale, sight, spacing, people, count, person_reach, points
        )
        goal = goals[row].astype(np.float64)
        seen = spread_out(points[:kept], features)
        if detours.shape[0] > 1:
            stamp(points[:kept], prices.cell, prices.blocked, prices.close, effort)
            spread(effort, goal, prices.cell, detours)
        kept = keep_near(points[:kept], reach)
        first_costs(
            rollouts, prices, goal, detours, features[:seen], points[:kept], people, turning[row],
            start[row], every, base, ends, out[row],
        )  # fmt: skip
