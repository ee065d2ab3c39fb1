"""Half-planes of walls; those of RVO2 are in tests/references/test_orca.py."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.errors import UserError
from lndrl.world.orca import linear_program_2, linear_program_3, orca_velocity
from lndrl.world.orca_walls import (
    Walls,
    build_walls,
    near_edges,
    tile_boxes,
    tile_of,
    wall_edges,
    wall_lines,
)

SQUARE = np.array([(2.0, -1.0), (4.0, -1.0), (4.0, 1.0), (2.0, 1.0)])
SPEED, RADIUS, HORIZON = 0.5, 0.2, 5.0
REACH = HORIZON * SPEED + RADIUS


def lines_of(walls, x, y, vx=0.0, vy=0.0):
    room = walls.most + 1
    nearest, distance2, lines = np.zeros(room, np.int64), np.zeros(room), np.zeros((room, 4))
    tile = tile_of(x, y, walls.rows, walls.columns, walls.left, walls.bottom)
    begin, end = (0, 0) if tile < 0 else map(int, walls.starts[tile : tile + 2])
    how = (RADIUS, HORIZON, SPEED, nearest, distance2, lines)
    count = wall_lines(x, y, vx, vy, walls.edges, walls.members, begin, end, *how)
    return lines[:count]


def violation(lines, v):
    return lines[:, 2] * (lines[:, 1] - v[1]) - lines[:, 3] * (lines[:, 0] - v[0])


def test_in_front_of_a_wall_only_the_way_to_it_is_slowed():
    walls = build_walls([SQUARE], REACH)
    (line,) = lines_of(walls, 1.0, 0.0, 0.4, 0.0)
    # 1 m to the wall less the body, in 5 s.
    assert violation(line[None], (0.159, 0.3))[0] <= 0 < violation(line[None], (0.161, 0.3))[0]


def test_walls_are_seen_from_outside_and_within_reach_only():
    walls = build_walls([SQUARE], REACH)
    assert len(lines_of(walls, 3.0, 0.0)) == 0  # inside the solid
    assert len(lines_of(walls, 2.0 - REACH - 0.01, 0.0)) == 0
    assert len(lines_of(walls, 2.0 - REACH + 0.01, 0.0)) == 1
    assert len(lines_of(walls, 500.0, -500.0)) == 0
    room = build_walls([SQUARE[::-1]], REACH)  # clockwise: the inside is free
    assert len(lines_of(room, 3.0, 0.0)) == 4
    assert len(lines_of(build_walls([], REACH), 0.0, 0.0)) == 0


@given(st.integers(0, 10_000))
def test_tiles_hide_no_edge(seed):
    rng = np.random.default_rng(seed)
    outlines = [rng.uniform(-6, 6, 2) + rng.uniform(-1, 1, (3, 2)) for _ in range(8)]
    walls = build_walls(outlines, REACH)
    room = len(walls.edges)
    nearest, distance2 = np.zeros(room, np.int64), np.zeros(room)
    everything = np.arange(room, dtype=np.int32)
    for x, y in rng.uniform(-10, 10, (20, 2)):
        tile = tile_of(x, y, walls.rows, walls.columns, walls.left, walls.bottom)
        begin, end = (0, 0) if tile < 0 else map(int, walls.starts[tile : tile + 2])
        args = (REACH, nearest, distance2)
        count = near_edges(x, y, walls.edges, walls.members, begin, end, *args)
        tiled = nearest[:count].tolist()
        count = near_edges(x, y, walls.edges, everything, 0, room, *args)
        assert tiled == nearest[:count].tolist()
        assert (np.diff(distance2[:count]) >= 0).all()


@given(st.integers(0, 10_000))
def test_scale_and_turn_do_not_matter(seed):
    """All lengths times k, all velocities times k: the half-planes' points grow by k as well."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1.0, 1.5), rng.uniform(-2.5, 2.5)
    velocity = rng.uniform(-0.5, 0.5, 2)
    base = lines_of(build_walls([SQUARE], REACH), x, y, *velocity)
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    walls = build_walls([SQUARE @ turn.T], REACH)
    turned = lines_of(walls, *(turn @ [x, y]), *(turn @ velocity))
    for v in rng.uniform(-0.5, 0.5, (5, 2)):
        assert violation(turned, turn @ v) == pytest.approx(violation(base, v), abs=1e-9)


def test_lines_of_walls_are_never_given_up():
    rng = np.random.default_rng(3)
    checked = 0
    while checked < 60:
        angle = rng.uniform(-np.pi, np.pi, 7)
        spread = np.array([0.15] * 2 + [0.6] * 5)
        point = rng.normal(0, 1, (7, 2)) * spread[:, None]
        lines = np.column_stack([point, np.cos(angle), np.sin(angle)])
        # Walls always allow to stand still or nearly so.
        outside = violation(lines, (0.0, 0.0))
        lines[:2, :2] += (
            np.column_stack([-np.sin(angle), np.cos(angle)])[:2]
            * -(np.maximum(outside[:2], 0.0) + 0.01)[:, None]
        )
        target = rng.normal(0, 0.4, 2)
        failed, x, y = linear_program_2(lines, 7, SPEED, *target, False)
        if failed == 7:
            continue
        x, y = linear_program_3(lines, 7, 2, failed, SPEED, x, y, np.zeros((7, 4)))
        assert violation(lines[:2], (x, y)).max() <= 1e-7
        assert np.hypot(x, y) <= SPEED + 1e-7
        # Of all velocities that meet the walls, none is nearer to meeting the others.
        grid = rng.uniform(-SPEED, SPEED, (1000, 2))
        grid = grid[np.hypot(*grid.T) <= SPEED]
        outside = np.array([violation(lines, g) for g in grid])
        best = outside[outside[:, :2].max(axis=1) <= 0][:, 2:].max(axis=1).min()
        assert violation(lines[2:], (x, y)).max() <= best + 1e-6
        checked += 1


def test_a_pair_of_agents_mirrors_itself():
    """Reciprocity: seen from either side, the two new velocities are point reflections."""
    rng = np.random.default_rng(4)
    for _ in range(100):
        offset, velocity, target = rng.uniform(-1, 1, 2), *rng.normal(0, 0.3, (2, 2))
        position = np.array([offset, -offset])
        velocities = np.array([velocity, -velocity])
        scratch = np.zeros(2, np.int64), np.zeros(2), np.zeros((2, 4)), np.zeros((2, 4))
        how = (0, 5.0, 2, HORIZON, 0.3, SPEED, 0.1)
        one = orca_velocity(0, position, velocities, 2, *target, *how, *scratch)
        two = orca_velocity(1, position, velocities, 2, *-target, *how, *scratch)
        assert np.array(one) == pytest.approx(-np.array(two), abs=1e-9)


@pytest.mark.parametrize("outline", [[(0.0, 0.0)], [(1.0, 1.0)] * 3, [(0.0, np.nan), (1.0, 0.0)]])
def test_outlines_that_enclose_nothing_are_refused(outline):
    with pytest.raises(UserError, match="outline 1: "):
        build_walls([SQUARE, np.array(outline)], REACH)


def members_of_all_distances(
    edges: np.ndarray, walls: Walls, reach: float
) -> tuple[list[int], list[int]]:
    """``members`` and ``starts`` as a look at every edge from every tile gives them."""
    starts, members = [0], list[int]()
    for tile in range(walls.rows * walls.columns):
        row, column = divmod(tile, walls.columns)
        middle = np.array([walls.left, walls.bottom]) + 0.5 + [column, row]
        offset = middle - edges[:, :2]
        along = (offset * edges[:, 4:6]).sum(axis=1).clip(0.0, edges[:, 12])
        apart = np.hypot(*(offset - along[:, None] * edges[:, 4:6]).T)
        members += np.flatnonzero(apart <= reach + np.sqrt(0.5) + 1e-6).tolist()
        starts.append(len(members))
    return members, starts


@given(st.integers(0, 10_000))
def test_tiles_hold_the_edges_that_a_look_at_all_of_them_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    outlines = [rng.uniform(-9, 9, 2) + rng.uniform(-5, 5, (rng.integers(2, 7), 2)) for _ in "four"]
    reach = float(rng.choice([REACH, RADIUS]))
    walls = build_walls(outlines, reach)
    members, starts = members_of_all_distances(walls.edges, walls, reach)
    assert walls.members.tolist() == members and walls.starts.tolist() == starts


def speckles(side: float) -> list[np.ndarray]:
    """Cells of 5 cm, one in every square metre of a hall, as SLAM leaves them."""
    cell = 0.05 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    return [cell + np.array([x, y]) for x in np.arange(0.5, side) for y in np.arange(0.5, side)]


def test_an_edge_is_looked_at_from_the_tiles_in_its_reach_only() -> None:
    """So a hall of four times the speckles costs four times as much, not sixteen times."""
    for side in (20.0, 40.0):
        edges = wall_edges(speckles(side))
        walls = build_walls(speckles(side), REACH)
        far = REACH + np.sqrt(0.5) + 1e-6
        corner = np.array([walls.left, walls.bottom])
        boxes = tile_boxes(edges, far, corner, walls.rows, walls.columns)
        looks = ((boxes[:, 2:] - boxes[:, :2] + 1).prod(axis=1)).sum()
        assert len(walls.members) <= looks <= len(edges) * (2 * far + 0.05 + 1.0) ** 2
        assert looks < 1.6 * len(walls.members)
