"""Ways on which scans tell much: lengths, detours, and what cannot be driven."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.maps.localizability import HEADINGS, LocalizabilityField, Sensor, grid_hash
from lndrl.planners.ways import WayPrices, Ways
from lndrl.scenario import Scenario
from lndrl.world import Place

SENSOR = Sensor(beams=60, field_of_view=np.pi, range_max=12.0, sigma=0.2, farthest=2.0)
PLAIN = WayPrices(doubt=0.0, sure=0.1, unsure=0.5, room=0.3)


@pytest.fixture(scope="module")
def place() -> Place:
    """8 x 6 m, a wall from below to y = 4 in the middle."""
    return Place.build(
        Scenario.model_validate(
            {
                "name": "wall",
                "size": [8, 6],
                "obstacles": [{"box": [3.9, 0, 4.1, 4]}],
                "pedestrians": {"count": [0, 0]},
                "robot": [{"start": [1, 1, 2, 2], "goal": [6, 1, 7, 2]}],
            }
        )
    )


def field_of(place: Place, deviation: float = 0.05) -> LocalizabilityField:
    width, height = place.grid.size
    shape = (round(height / 0.25), round(width / 0.25))
    return LocalizabilityField(
        np.full((*shape, HEADINGS), deviation, np.float32), np.ones(shape, bool), 0.25, (0.0, 0.0),
        SENSOR, grid_hash(place.grid),
    )  # fmt: skip


def at(values, x, y):
    return values[int(y / 0.25), int(x / 0.25)]


def test_it_leads_around_the_wall(place) -> None:
    left = Ways.build(place, field_of(place), PLAIN).left(np.array([6.0, 1.0]))
    assert at(left, 6.0, 1.0) < 0.4
    assert at(left, 6.0, 4.0) == pytest.approx(3.0, abs=0.4)
    # Over the wall's end at (4, 4) and 0.3 m of room: twice hypot(2, 3.4) m, not 4.
    assert at(left, 2.0, 1.0) == pytest.approx(2 * np.hypot(2.0, 3.4), abs=0.5)
    assert np.isfinite(left).all()  # inside of the wall as well


def test_where_scans_tell_little_ways_are_dearer_up_to_a_limit(place) -> None:
    field = field_of(place)
    field.deviation[8:16, 16:] = 0.3  # a band at y from 2 to 4 on the right
    prices = PLAIN._replace(doubt=10.0)
    goal = np.array([6.0, 5.0])
    more = Ways.build(place, field, prices).left(goal)
    plain = Ways.build(place, field, PLAIN).left(goal)
    assert (more >= plain - 1e-9).all()
    # 2 m of the way at (0.3 - 0.1) * 10 = 2 more each, its borders half of it.
    assert at(more - plain, 6.0, 1.0) == pytest.approx(4.0, abs=0.6)
    assert at(more - plain, 2.0, 5.0) == 0.0
    field.deviation[8:16, 16:] = 2.0  # counts as 0.5
    assert at(Ways.build(place, field, prices).left(goal) - plain, 6.0, 1.0) == pytest.approx(
        8.0, abs=1.2
    )


def test_it_is_the_heading_of_the_way_that_counts(place) -> None:
    field = field_of(place)
    field.deviation[..., : HEADINGS // 4] = 0.5  # looking right and up
    field.deviation[..., 3 * HEADINGS // 4 + 1 :] = 0.5  # looking right and down
    prices = PLAIN._replace(doubt=10.0)
    goals = np.array([1.0, 5.0]), np.array([7.0, 5.0])
    to_left, to_right = (Ways.build(place, field, prices).left(goal) for goal in goals)
    assert at(to_left, 7.0, 5.0) == pytest.approx(6.0, abs=0.4)
    assert at(to_right, 1.0, 5.0) == pytest.approx(6.0 * (1 + 10 * 0.4), rel=0.1)


def test_without_room_there_are_no_ways_and_nothing_is_dear(place) -> None:
    left = Ways.build(place, field_of(place), PLAIN._replace(room=50.0)).left(np.array([1.0, 1.0]))
    assert not left.any()


def test_a_goal_that_cannot_be_reached_is_no_number_less(place) -> None:
    left = Ways.build(place, field_of(place), PLAIN._replace(room=1.1)).left(np.array([6.0, 1.0]))
    assert np.isfinite(left).all()
