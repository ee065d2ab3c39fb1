"""Scenarios refuse shapes and crowds that cannot be."""

from __future__ import annotations

from typing import Any

import pytest

from lndrl.config import REPOSITORY_CONFIGS, load_scenario
from lndrl.errors import UserError
from lndrl.models import validate
from lndrl.scenario import Scenario

ROUTE = {"start": [1, 1, 2, 2], "goal": [8, 4, 9, 5]}


def scenario(**changes: Any) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "name": "room",
        "size": [10.0, 6.0],
        "obstacles": [{"box": [4, 2, 5, 3]}, {"circle": [7, 4, 0.3]}],
        "pedestrians": {"count": [1, 2], "routes": [ROUTE]},
        "robot": [ROUTE],
    }
    return {**plain, **changes}


def refusal(data: object) -> str:
    with pytest.raises(UserError) as caught:
        validate(Scenario, data, "room.yaml")
    return str(caught.value)


def test_defaults_are_filled_in() -> None:
    room = validate(Scenario, scenario(), "room.yaml")
    assert room.resolution == 0.05
    assert room.pedestrians.routes[0].both_ways
    assert room.obstacles[1].circle == (7.0, 4.0, 0.3)


def test_a_place_without_people_needs_no_routes() -> None:
    empty = validate(Scenario, scenario(pedestrians={"count": [0, 0]}), "room.yaml")
    assert empty.pedestrians.routes == []


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"obstacles": [{}]}, "obstacles.0: an obstacle needs exactly one of box, circle, polygon"),
        ({"obstacles": [{"box": [0, 0, 1, 1], "circle": [1, 1, 1]}]}, "exactly one of box"),
        ({"obstacles": [{"box": [4, 2, 3, 3]}]}, "must be [x_min, y_min, x_max, y_max]"),
        ({"obstacles": [{"circle": [4, 2, 0]}]}, "a circle's radius must be above 0"),
        ({"obstacles": [{"polygon": [[0, 0], [1, 1]]}]}, "at least 3 corners"),
        ({"pedestrians": {"count": [3, 2], "routes": [ROUTE]}}, "must be [fewest, most]"),
        ({"pedestrians": {"count": [-1, 2], "routes": [ROUTE]}}, "must be [fewest, most]"),
        ({"pedestrians": {"count": [1, 2]}}, "at least one route"),
        ({"pedestrians": {"count": [1, 2], "routes": [ROUTE], "orca": 1.5}}, "pedestrians.orca"),
        ({"robot": []}, "robot = []"),
        ({"resolution": 0}, "resolution = 0"),
        ({"size": [10]}, "size"),
        ({"colour": "red"}, "room.yaml: unknown key colour"),
        ({"robot": [{**ROUTE, "wieght": 2}]}, "robot.0.wieght; did you mean weight?"),
    ],
)
def test_impossible_scenarios(changes: dict[str, Any], sentence: str) -> None:
    assert sentence in refusal(scenario(**changes))


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UserError, match=r"scenario 'hybird' is unknown; did you mean hybrid\?"):
        load_scenario("hybird")


@pytest.mark.parametrize("path", sorted((REPOSITORY_CONFIGS / "scenarios").glob("*.yaml")), ids=str)
def test_shipped_scenarios_load(path) -> None:
    assert load_scenario(path.stem).name == path.stem


HALL = scenario(name="hall")


def mixture(**changes: Any) -> dict[str, Any]:
    places = [{"scenario": scenario()}, {"scenario": HALL, "weight": 3.0}]
    return {"name": "both", "kind": "mixed", "mixed": {"places": places}, **changes}


def test_a_mixture_stands_for_its_places() -> None:
    both = validate(Scenario, mixture(), "both.yaml")
    assert [part.name for part in both.parts] == ["room", "hall"]
    assert both.layouts is both.mixed
    room = both.parts[0]
    assert room.parts == (room,) and room.layouts is None


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"mixed": None}, "mixed is missing; name its places"),
        ({"mixed": {"places": []}}, "mixed.places"),
        ({"mixed": {"places": [{"scenario": HALL, "weight": 0}]}}, "mixed.places.0.weight"),
        ({"mixed": {"places": [{"scenario": mixture()}]}}, "both is mixed itself"),
        ({"size": [10.0, 6.0]}, "size belongs to each of mixed.places; leave it out here"),
        ({"pedestrians": {"count": [1, 2]}}, "pedestrians belongs to each of mixed.places"),
        ({"kind": "random"}, "mixed needs kind: mixed"),
    ],
)
def test_mixtures_that_cannot_be(changes: dict[str, Any], sentence: str) -> None:
    assert sentence in refusal(mixture(**changes))
