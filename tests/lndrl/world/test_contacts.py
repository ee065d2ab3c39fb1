"""Contacts against pymunk, which knows nothing of outlines, fields and short cuts."""

import numpy as np
import pymunk
import pytest

from lndrl.scenario import Scenario
from lndrl.world import Place
from lndrl.world.contacts import HITS, contact
from lndrl.world.orca_walls import build_walls

SCENARIO = Scenario.model_validate(
    {
        "name": "small",
        "size": [8.0, 6.0],
        "obstacles": [
            {"box": [3.0, 3.0, 4.0, 3.5]},
            {"circle": [6.0, 2.0, 0.4]},
            {"polygon": [[1.0, 4.0], [2.0, 4.0], [1.5, 5.0]]},
        ],
        "pedestrians": {"count": [0, 0]},
        "robot": [{"start": [0.5, 0.5, 1, 1], "goal": [7, 5, 7.5, 5.5]}],
    }
)
PLACE = Place.build(SCENARIO)
WALLS = build_walls(PLACE.outlines, 0.17)


def touch(x, y, legs=()):
    legs = np.array(legs, dtype=float).reshape(-1, 2)
    pose = np.array([x, y, 0.0])
    return HITS[contact(pose, legs, WALLS, PLACE.distance, 20.0, 0.17, 0.1)]


@pytest.fixture(scope="module")
def space():
    """The scenario's solids as pymunk shapes, circles exact."""
    space = pymunk.Space()
    body = space.static_body
    corners = [(3, 3), (4, 3), (4, 3.5), (3, 3.5)]
    space.add(pymunk.Poly(body, corners), pymunk.Poly(body, [(1, 4), (2, 4), (1.5, 5)]))
    space.add(pymunk.Circle(body, 0.4, (6, 2)))
    inside = [(0.1, 0.1), (7.9, 0.1), (7.9, 5.9), (0.1, 5.9)]
    for a, b in zip(inside, inside[1:] + inside[:1], strict=True):
        space.add(pymunk.Segment(body, a, b, 0.0))
    return space


def test_walls_are_where_pymunk_has_them(space):
    rng = np.random.default_rng(3)
    hits = doubtful = 0
    for x, y in rng.uniform([0.12, 0.12], [7.88, 5.88], (6000, 2)):
        info = space.point_query_nearest((x, y), 3.0, pymunk.ShapeFilter())
        gap = 3.0 if info is None else info.distance
        if abs(gap - 0.17) < 0.0105:
            doubtful += 1  # a circle is a polygon here, 1 cm less at most
            continue
        assert touch(x, y) == ("wall" if gap < 0.17 else ""), (x, y)
        hits += gap < 0.17
    assert hits > 500 and doubtful < 250


@pytest.mark.parametrize(
    ("x", "y", "dx", "dy"),
    [
        (3.0 - 0.17, 3.2, -1, 0),  # left face of the box
        (3.5, 3.5 + 0.17, 0, 1),  # its top
        (6.0 + 0.57, 2.0, 1, 0),  # circle, at a corner of its outline
        (1.5, 4.0 - 0.17, 0, -1),  # polygon's base
        (0.1 + 0.17, 2.5, 1, 0),  # outer walls
        (8.0 - 0.1 - 0.17, 2.5, -1, 0),
        (4.5, 0.1 + 0.17, 0, 1),
        (4.5, 6.0 - 0.1 - 0.17, 0, -1),
    ],
)
def test_walls_are_exact_to_a_millimetre(x, y, dx, dy):
    assert touch(x + 0.001 * dx, y + 0.001 * dy) == ""
    assert touch(x - 0.001 * dx, y - 0.001 * dy) == "wall"


def test_legs_are_exact_and_named():
    legs = [(5.0, 4.5), (5.2, 4.5)]
    assert touch(5.0 - 0.271, 4.5, legs) == ""
    assert touch(5.0 - 0.269, 4.5, legs) == "pedestrian"
    assert touch(5.0 - 0.269, 4.5) == ""


def test_the_deeper_contact_is_named():
    assert touch(2.84, 3.2, [(2.75, 3.2)]) == "pedestrian"
    assert touch(2.95, 3.2, [(2.69, 3.2)]) == "wall"


def test_inside_a_solid_and_off_the_map_is_a_wall():
    assert touch(3.5, 3.25) == "wall"
    assert touch(-0.5, 3.0) == "wall" and touch(4.0, 6.2) == "wall"
    assert touch(np.nan, 3.0) == "wall"
