import numpy as np
import pytest

from lndrl.maps import distance_field, grid_from_scenario
from lndrl.scenario import Scenario
from lndrl.world.contacts import Contacts, may_touch

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
GRID = grid_from_scenario(SCENARIO)
FIELD = distance_field(GRID.occupied, GRID.resolution)


def touch(contacts, x, y, legs=()):
    legs = np.array(legs, dtype=float).reshape(-1, 2)
    return contacts.hit(np.array([x, y, 0.0]), legs, FIELD, GRID.resolution)


@pytest.fixture(scope="module")
def contacts():
    return Contacts(SCENARIO, 0.17, 0.1, 4)


@pytest.mark.parametrize(
    ("x", "y", "dx", "dy"),
    [
        (3.0 - 0.17, 3.2, -1, 0),  # left face of the box
        (3.5, 3.5 + 0.17, 0, 1),  # its top
        (6.0 + 0.57, 2.0, 1, 0),  # circle
        (1.5, 4.0 - 0.17, 0, -1),  # polygon's base
        (0.1 + 0.17, 2.5, 1, 0),  # outer walls
        (8.0 - 0.1 - 0.17, 2.5, -1, 0),
        (4.5, 0.1 + 0.17, 0, 1),
        (4.5, 6.0 - 0.1 - 0.17, 0, -1),
    ],
)
def test_walls_are_exact_to_a_millimetre(contacts, x, y, dx, dy):
    assert touch(contacts, x + 0.001 * dx, y + 0.001 * dy) == ""
    assert touch(contacts, x - 0.001 * dx, y - 0.001 * dy) == "wall"


def test_legs_are_exact_and_named(contacts):
    legs = [(5.0, 4.5), (5.2, 4.5)]
    assert touch(contacts, 5.0 - 0.271, 4.5, legs) == ""
    assert touch(contacts, 5.0 - 0.269, 4.5, legs) == "pedestrian"
    assert touch(contacts, 5.0 - 0.269, 4.5) == "", "legs of an earlier call are gone"


def test_the_deeper_contact_is_named(contacts):
    assert touch(contacts, 2.84, 3.2, [(2.75, 3.2)]) == "pedestrian"
    assert touch(contacts, 2.95, 3.2, [(2.69, 3.2)]) == "wall"


def test_the_cheap_test_never_hides_a_contact():
    rng = np.random.default_rng(1)
    everywhere, walls_only = Contacts(SCENARIO, 0.17, 0.1, 4), Contacts(SCENARIO, 0.17, 0.1, 0)
    hits = 0
    for _ in range(400):
        pose = np.array([rng.uniform(0.1, 7.9), rng.uniform(0.1, 5.9), 0.0])
        legs = pose[:2] + rng.normal(0, 0.4, (4, 2))
        if not may_touch(pose, legs, FIELD, 1 / GRID.resolution, 0.17, 0.1):
            assert np.hypot(*(legs - pose[:2]).T).min() > 0.27
            query = walls_only._space.point_query_nearest
            assert query((pose[0], pose[1]), 0.17, walls_only._filter) is None
        else:
            hits += everywhere.hit(pose, legs, FIELD, GRID.resolution) != ""
    assert hits > 50


def test_without_pedestrians_it_works_too():
    contacts = Contacts(SCENARIO, 0.17, 0.1, 0)
    assert touch(contacts, 3.5, 3.2) == "wall"
    assert touch(contacts, 5.0, 4.5) == ""
