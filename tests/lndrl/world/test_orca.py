import itertools

import numpy as np
import pytest

from lndrl.world.orca import linear_program_2, linear_program_3, orca_line, orca_velocity

SPEED = 0.5


def violation(lines, v):
    """How far v lies outside each half-plane (m/s); a row is [px, py, dx, dy], left allowed."""
    return lines[:, 2] * (lines[:, 1] - v[1]) - lines[:, 3] * (lines[:, 0] - v[0])


def slow_program(lines, target):
    """Best of all candidate optima: target, its projections, and all corners."""
    candidates = [target, target / max(np.linalg.norm(target), 1e-12) * SPEED]
    for px, py, dx, dy in lines:
        p, d = np.array([px, py]), np.array([dx, dy])
        candidates.append(p + d * (d @ (target - p)))
        root = (p @ d) ** 2 + SPEED**2 - p @ p
        if root >= 0:
            candidates += [p + d * (-(p @ d) + s * np.sqrt(root)) for s in (-1, 1)]
    for a, b in itertools.combinations(lines, 2):
        matrix = np.array([[a[2], -b[2]], [a[3], -b[3]]])
        if abs(np.linalg.det(matrix)) > 1e-6:
            t = np.linalg.solve(matrix, b[:2] - a[:2])[0]
            candidates.append(a[:2] + t * a[2:])
    feasible = [
        c
        for c in candidates
        if np.linalg.norm(c) <= SPEED + 1e-9 and (violation(lines, c) <= 1e-9).all()
    ]
    return min(feasible, key=lambda c: np.linalg.norm(c - target), default=None)


def random_lines(rng, n, spread):
    angle = rng.uniform(-np.pi, np.pi, n)
    return np.column_stack([rng.normal(0, spread, (n, 2)), np.cos(angle), np.sin(angle)])


def test_linear_program_matches_the_enumeration_of_all_corners():
    rng = np.random.default_rng(1)
    solved = failed = 0
    for _ in range(400):
        n = rng.integers(1, 6)
        lines = random_lines(rng, n, 0.3)
        target = rng.normal(0, 0.5, 2)
        want = slow_program(lines, target)
        index, x, y = linear_program_2(lines, n, SPEED, *target, False)
        if want is None:
            assert index < n
            failed += 1
            continue
        assert index == n
        assert np.array([x, y]) == pytest.approx(want, abs=1e-7)
        solved += 1
    assert solved > 50 and failed > 50


def test_fallback_minimises_the_worst_violation():
    rng = np.random.default_rng(2)
    angle, radius = np.meshgrid(np.linspace(-np.pi, np.pi, 181), np.linspace(0, SPEED, 51))
    grid = np.column_stack([(radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()])
    checked = 0
    while checked < 60:
        n = int(rng.integers(2, 6))
        lines = random_lines(rng, n, 0.4)
        target = rng.normal(0, 0.3, 2)
        index, x, y = linear_program_2(lines, n, SPEED, *target, False)
        if index == n:
            continue
        x, y = linear_program_3(lines, n, 0, index, SPEED, x, y, np.zeros((n, 4)))
        assert np.hypot(x, y) <= SPEED + 1e-9
        best = min(violation(lines, g).max() for g in grid[::7])
        assert violation(lines, (x, y)).max() <= best + 1e-6
        checked += 1


def slow_line(relative, own, other, combined, horizon, period):
    """The half-plane by geometry: nearest border point of the truncated cone to the slip.

    The border is sampled, so this twin shares no formula with the kernel.
    """
    distance = np.linalg.norm(relative)
    slip = own - other
    if distance <= combined:
        center, radius = relative / period, combined / period
        out = (slip - center) / np.linalg.norm(slip - center)
        return own + 0.5 * (center + radius * out - slip), out
    half = np.arcsin(combined / distance)
    toward = np.arctan2(relative[1], relative[0])
    leg = np.sqrt(distance**2 - combined**2)
    points, normals = [], []
    for side in (-1, 1):
        direction = np.array([np.cos(toward + side * half), np.sin(toward + side * half)])
        t = np.linspace(leg / horizon, leg / horizon + 6, 60_001)
        points.append(t[:, None] * direction)
        normal = side * np.array([-direction[1], direction[0]])
        normals.append(np.tile(normal, (len(t), 1)))
    arc = toward + np.pi + np.linspace(half - np.pi / 2, np.pi / 2 - half, 20_001)
    unit = np.column_stack([np.cos(arc), np.sin(arc)])
    points.append(relative / horizon + combined / horizon * unit)
    normals.append(unit)
    edge, outward = np.vstack(points), np.vstack(normals)
    nearest = np.argmin(((edge - slip) ** 2).sum(axis=1))
    return own + 0.5 * (edge[nearest] - slip), outward[nearest]


def test_half_plane_matches_the_velocity_obstacle_drawn_point_by_point():
    rng = np.random.default_rng(3)
    for _ in range(120):
        relative = rng.uniform(-3, 3, 2)
        own, other = rng.normal(0, 0.5, (2, 2))
        point, normal = slow_line(relative, own, other, 0.8, 3.0, 0.4)
        px, py, dx, dy = orca_line(*relative, *own, *other, 0.8, 3.0, 0.4, 1.0)
        # Allowed side is the left of the direction, where the outward normal points.
        assert [-dy, dx] == pytest.approx(normal, abs=2e-3)
        assert (np.array([px, py]) - point) @ normal == pytest.approx(0.0, abs=2e-3)


def test_two_that_nothing_tells_apart_get_opposite_half_planes():
    for relative, slip in (((0.0, 0.0), (0.0, 0.0)), ((0.2, 0.0), (0.5, 0.0))):
        own, other = np.array([0.1, 0.3]), np.array([0.1, 0.3]) - slip
        here = orca_line(*relative, *own, *other, 0.8, 3.0, 0.4, -1.0)
        there = orca_line(*np.negative(relative), *other, *own, 0.8, 3.0, 0.4, 1.0)
        assert np.subtract(here[:2], own) == pytest.approx(np.subtract(other, there[:2]))
        assert np.subtract(here[:2], own) == pytest.approx([-1.0, 0.0])  # 0.8 / 0.4 / 2
        assert here[2:] == pytest.approx(np.negative(there[2:]))
    # Where something does tell them apart, it makes no difference.
    apart = (0.1, -0.2, 0.3, 0.0, -0.1, 0.2, 0.8, 3.0, 0.4)
    assert orca_line(*apart, 1.0) == orca_line(*apart, -1.0)


def scratch_for(lines):
    return np.zeros(lines, np.int64), np.zeros(lines), np.zeros((lines, 4)), np.zeros((lines, 4))


def run(position, goal, steps, radius=0.3, distance=5.0, tick=0.1):
    agents = len(position)
    velocity = np.zeros((agents, 2))
    scratch = scratch_for(10)
    closest = np.inf
    for _ in range(steps):
        new = np.zeros_like(velocity)
        for i in range(agents):
            to_goal = goal[i] - position[i]
            target = to_goal / max(np.linalg.norm(to_goal), 1.0)
            new[i] = orca_velocity(
                i,
                position,
                velocity,
                agents,
                *target,
                0,
                distance,
                10,
                5.0,
                radius,
                SPEED,
                tick,
                *scratch,
            )
        velocity = new
        position = position + tick * velocity
        gaps = [float(np.linalg.norm(a - b)) for a, b in itertools.combinations(position, 2)]
        closest = min(closest, *gaps)
    return position, closest


def test_two_agents_head_on_pass_without_overlap():
    start = np.array([[0.0, 0.0], [6.0, 0.01]])
    end, closest = run(start, start[::-1].copy(), 200)
    assert closest >= 0.6 - 1e-3
    assert end == pytest.approx(start[::-1], abs=0.1)


def test_four_agents_cross_without_overlap():
    angle = np.linspace(0, 2 * np.pi, 4, endpoint=False) + 0.05 * np.arange(4)
    start = 3.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    _, closest = run(start, -start, 300)
    assert closest >= 0.6 - 5e-3


def test_only_the_nearest_neighbours_count():
    rng = np.random.default_rng(5)
    position = rng.uniform(-2, 2, (16, 2))
    position[0] = 0.0
    velocity = rng.normal(0, 0.3, (16, 2))
    scratch = scratch_for(4)
    args = (0.4, 0.1, 0, 1.5, 4, 5.0, 0.3, SPEED, 0.1)
    got = orca_velocity(0, position, velocity, 16, *args, *scratch)
    order = np.argsort(np.linalg.norm(position, axis=1))[:5]  # itself and the four nearest
    assert np.linalg.norm(position[order[4]]) < 1.5
    want = orca_velocity(0, position[order], velocity[order], 5, *args, *scratch)
    assert got == want
    far = position.copy()
    far[1:] += np.sign(far[1:]) * 2.0
    free = orca_velocity(0, far, velocity, 16, *args, *scratch)
    assert free == pytest.approx((0.4, 0.1))
