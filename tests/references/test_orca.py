"""ORCA beside RVO2 (package ``pyrvo``): one step of random scenes, with and without walls.

RVO2 computes in float32 and cuts edges where the lines of other edges cross them; the cuts are
read back, so that both see the same edges. Two things are left to chance, counted and bounded:

- tie: two edges whose nearest point is the corner they share. RVO2 takes first whichever its tree
  meets first, and what the first covers, the second need not say. With RVO2's order read back,
  we must give its answer.
- degenerate: the answer itself jumps (hardly any velocity is allowed, who is the tenth
  neighbour), so float32 may land on the other side. Only where our half-planes are RVO2's and our
  linear programs make its velocity of them, or where its velocity jumps as well when the agents
  are shifted by 3e-6 m and m/s.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from lndrl.world.orca import linear_program_2, linear_program_3, near_agents, orca_velocity
from lndrl.world.orca_walls import build_walls, tile_of, wall_lines

pyrvo = pytest.importorskip("pyrvo")

TOLERANCE = 1e-4  # m/s
SCENES = 1000


@dataclass
class Scene:
    position: np.ndarray
    velocity: np.ndarray
    preferred: np.ndarray
    outlines: list
    radius: float
    distance: float
    most: int
    horizon: float
    horizon_obstacle: float
    speed: float
    period: float


def rectangle(rng):
    size = rng.uniform(0.3, 2.0, 2)
    angle = rng.choice([0.0, rng.uniform(-np.pi, np.pi)])
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * size / 2
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return corners @ turn.T


def star(rng):
    """A polygon around its middle, counter-clockwise, in general not convex."""
    n = int(rng.integers(3, 9))
    angle = (np.arange(n) + rng.uniform(0.1, 0.9, n)) * 2 * np.pi / n
    radius = rng.uniform(0.3, 1.4, n)[:, None]
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def random_outlines(rng):
    """Up to five solids that do not overlap, sometimes inside a room."""
    outlines = []
    if rng.random() < 0.5:
        size = rng.uniform(4.0, 5.0, 2)  # half sizes; clockwise: the room is on the right
        outlines.append(size * np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)]))
    cells = [(x, y) for x in (-2.5, 0.0, 2.5) for y in (-2.5, 0.0, 2.5)]
    for k in rng.permutation(len(cells))[: rng.integers(1, 6)]:
        shape = rectangle(rng) if rng.random() < 0.5 else star(rng)
        scale = min(1.0, 1.15 / np.abs(shape).max())
        outlines.append(scale * shape + cells[k])
    return outlines


def inside(outline, point):
    a, b = outline, np.roll(outline, -1, axis=0)
    spans = (a[:, 1] <= point[1]) != (b[:, 1] <= point[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = a[:, 0] + (point[1] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return bool((spans & (point[0] < x)).sum() % 2)


def random_scene(rng, walls):
    agents = int(rng.integers(1, 16))
    outlines = random_outlines(rng) if walls else []
    solids = outlines[1:] if outlines and outlines[0].shape == (4, 2) else outlines
    position: list[np.ndarray] = []
    while len(position) < agents:
        point = rng.uniform(-3.9, 3.9, 2)
        if not any(inside(o, point) for o in solids):
            position.append(point)
    speed = rng.uniform(0.4, 2.0)
    return Scene(
        position=np.array(position).astype(np.float32).astype(np.float64),
        velocity=rng.uniform(-1, 1, (agents, 2)) * speed / np.sqrt(2),
        preferred=rng.uniform(-1.2, 1.2, (agents, 2)) * speed,
        outlines=outlines,
        radius=rng.uniform(0.1, 0.5),
        distance=rng.choice([0.5, 3.0, 15.0]),
        most=int(rng.integers(1, 12)),
        horizon=rng.uniform(0.5, 6.0),
        horizon_obstacle=rng.uniform(0.5, 6.0),
        speed=speed,
        period=rng.choice([0.1, 0.25, 0.4]),
    )


def rvo2(s, shift=(0.0, 0.0)):
    """RVO2 after one step, the row in ``build_walls`` of its corners, and the outlines as its
    tree has cut them.
    """
    simulator = pyrvo.RVOSimulator(
        s.period, s.distance, s.most, s.horizon, s.horizon_obstacle, s.radius, s.speed
    )
    for outline in s.outlines:
        simulator.add_obstacle([tuple(map(float, c)) for c in outline])
    simulator.process_obstacles()
    moved = s.position + shift[0], s.velocity + shift[1]
    for p, v, w in zip(*moved, s.preferred, strict=True):
        agent = simulator.add_agent(tuple(map(float, p)))
        simulator.set_agent_velocity(agent, tuple(map(float, v)))
        simulator.set_agent_pref_velocity(agent, tuple(map(float, w)))
    cut: list[np.ndarray] = []
    row: dict[int, int] = {}
    for start in range(simulator.get_num_obstacle_vertices()):
        corners, k = [], start
        while k not in row:
            row[k] = len(row)
            corners.append(point(simulator.get_obstacle_vertex(k)))
            k = simulator.get_next_obstacle_vertex(k)
        if corners:
            cut.append(np.array(corners))
    simulator.do_step()
    return simulator, row, cut


def answers(s, simulator, row):
    """RVO2's velocities; for each agent the rows of the edges it looked at, in its order, how
    many of its half-planes are walls', and all of them as we write them.
    """
    velocities, looked_at, firm, lines = [], [], [], []
    for i in range(len(s.position)):
        velocities.append(point(simulator.get_agent_velocity(i)))
        seen = range(simulator.get_agent_num_obstacle_neighbors(i))
        looked_at.append([row[simulator.get_agent_obstacle_neighbor(i, k)] for k in seen])
        count = simulator.get_agent_num_orca_lines(i)
        firm.append(count - simulator.get_agent_num_agent_neighbors(i))
        pairs = [simulator.get_agent_orca_line(i, k) for k in range(count)]
        lines.append(np.array([(*p, *d) for d, p in pairs]).reshape(-1, 4))
    return np.array(velocities), looked_at, firm, lines


def point(vector):
    return (vector.x, vector.y) if hasattr(vector, "x") else tuple(vector)


def ours(s, outlines, order=None):
    """Our velocities and half-planes; edges are looked at in the order of ``order``, if given."""
    walls = build_walls(outlines, s.horizon_obstacle * s.speed + s.radius)
    room = s.most + len(walls.edges)
    nearest, distance2 = np.zeros(room, dtype=np.int64), np.zeros(room)
    lines, projected = np.zeros((room, 4)), np.zeros((room, 4))
    velocities, all_lines = [], []
    for i, ((x, y), (vx, vy)) in enumerate(zip(s.position, s.velocity, strict=True)):
        if order is not None:
            members = np.array(order[i], dtype=np.int32)
            begin, end = 0, len(members)
        else:
            members = walls.members
            tile = tile_of(x, y, walls.rows, walls.columns, walls.left, walls.bottom)
            begin, end = (0, 0) if tile < 0 else (walls.starts[tile], walls.starts[tile + 1])
        around = (x, y, vx, vy, walls.edges, members, int(begin), int(end))
        firm = wall_lines(*around, s.radius, s.horizon_obstacle, s.speed, nearest, distance2, lines)
        among = (i, s.position, s.velocity, len(s.position), *s.preferred[i], firm)
        how = (s.distance, s.most, s.horizon, s.radius, s.speed, s.period)
        velocities.append(orca_velocity(*among, *how, nearest, distance2, lines, projected))
        found = near_agents(i, s.position, len(s.position), s.distance, s.most, nearest, distance2)
        all_lines.append(lines[: firm + found].copy())
    return np.array(velocities), all_lines


def solve(s, i, lines, firm):
    """Our linear programs on given half-planes of agent ``i``."""
    count = len(lines)
    failed, x, y = linear_program_2(lines, count, s.speed, *s.preferred[i], False)
    if failed < count:
        scratch = np.zeros((count, 4))
        x, y = linear_program_3(lines, count, firm, failed, s.speed, x, y, scratch)
    return np.array([x, y])


def apart(a, b):
    return np.abs(a - b).max(axis=1) > TOLERANCE


def is_rounding(s, i, want, lines, firm, our_lines):
    """Whether agent ``i`` has RVO2's half-planes, and its velocity follows from them."""
    if len(lines) != len(our_lines) or np.abs(lines - our_lines).max(initial=0.0) > 5e-4:
        return False
    return np.abs(solve(s, i, lines, firm) - want[i]).max() <= TOLERANCE


def compare(walls, seed):
    """Numbers of agents, those that walls bent, and those that differ: by a tie, degenerate,
    otherwise.
    """
    rng = np.random.default_rng(seed)
    agents = bent = tied = degenerate = wrong = 0
    for _ in range(SCENES):
        scene = random_scene(rng, walls)
        simulator, row, cut = rvo2(scene)
        want, looked_at, firm, lines = answers(scene, simulator, row)
        got, _ = ours(scene, cut)
        agents += len(got)
        bent += apart(got, ours(scene, [])[0]).sum() if walls else 0
        differs = apart(got, want)
        if not differs.any():
            continue
        again, our_lines = ours(scene, cut, looked_at)
        shifts = np.random.default_rng(0).choice([-3e-6, 3e-6], (12, 2, len(got), 2))
        moved = [answers(scene, *rvo2(scene, shift)[:2])[0] for shift in shifts]
        jumps = np.any([apart(v, want) for v in moved], axis=0)
        for i in np.flatnonzero(differs):
            if not apart(again, want)[i]:
                tied += 1
            elif jumps[i] or is_rounding(scene, i, want, lines[i], firm[i], our_lines[i]):
                degenerate += 1
            else:
                wrong += 1
    return agents, bent, tied, degenerate, wrong


def test_velocities_are_those_of_rvo2_without_walls():
    agents, _, tied, degenerate, wrong = compare(False, 1)
    assert agents > 7000
    assert wrong == tied == 0
    assert degenerate <= 0.001 * agents


def test_velocities_are_those_of_rvo2_between_walls():
    agents, bent, tied, degenerate, wrong = compare(True, 2)
    assert agents > 7000
    assert bent > 0.3 * agents
    assert wrong == 0
    assert tied <= 0.003 * agents
    assert degenerate <= 0.001 * agents
