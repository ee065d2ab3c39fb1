"""Robots as files, and in words where one is not what a policy was trained for."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from lndrl.config import RunConfig, load_config, shipped
from lndrl.errors import UserError
from lndrl.models import validate
from lndrl.robot.shapes import RobotShape, differences, load_shape, world_of

PLAIN: dict[str, Any] = {
    "radius": 0.17,
    "speed": {"linear": 0.6, "angular": 0.9},
    "scanner": {"field_of_view": math.pi, "beams": 720, "range_min": 0.0, "range_max": 12.0},
}


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return load_config("lndrl")


def shape(**changes) -> RobotShape:
    data = {**PLAIN, **{k: v for k, v in changes.items() if k != "scanner"}}
    data["scanner"] = {**PLAIN["scanner"], **changes.get("scanner", {})}
    return validate(RobotShape, {k: v for k, v in data.items() if v is not None}, "here")


@pytest.mark.parametrize("name", shipped("robot"))
def test_every_robot_that_is_shipped_loads(name: str) -> None:
    robot = load_shape(name)
    assert robot.description and 0.05 < robot.reach < 0.5
    scanner = robot.scanner.scanner()
    assert scanner.range_min == robot.scanner.range_min and scanner.yaw == robot.scanner.yaw
    assert all(math.isfinite(each) for each in robot.acceleration.limits)


def test_the_robot_of_training_differs_in_nothing(config: RunConfig) -> None:
    assert differences(shape(), config) == []
    wide = shape(scanner={"field_of_view": math.tau, "beams": 2000, "range_max": 30.0})
    assert differences(wide, config) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scanner": {"field_of_view": 2.0}}, "sees 115 of the 180 degrees ahead"),
        ({"scanner": {"yaw": 1.0}}, "sees 123 of the 180 degrees ahead"),
        ({"scanner": {"yaw": math.pi, "field_of_view": 4.0}}, "sees 49 of the 180 degrees"),
        ({"scanner": {"range_max": 3.5}}, "sees 3.5 m far, the policy was trained with 12 m"),
        ({"scanner": {"range_min": 0.3}}, "nothing nearer than 0.3 m, which is up to 13 cm"),
        ({"scanner": {"beams": 180}}, "1 degrees apart, the policy was trained with 0.25"),
        ({"speed": {"linear": 0.26, "angular": 0.9}}, "drives 0.26 m/s at most"),
        ({"speed": {"linear": 0.6, "angular": 0.5}}, "turns 0.5 rad/s at most"),
        ({"acceleration": {"linear": 0.5}}, "0.5 m/s² and any rad/s², so that it drives 0.6 m/s"),
        ({"acceleration": {"linear": 2.0, "braking": 0.6}}, "(0.6 m/s² to brake)"),
        ({"radius": 0.25}, "radius is 0.25 m, the policy was trained with 0.17 m; it will pass"),
        (
            {"radius": None, "footprint": [[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]]},
            "radius is 0.361 m",
        ),
    ],
)
def test_each_difference_is_a_sentence(changes: dict, words: str, config: RunConfig) -> None:
    found = differences(shape(**changes), config)
    assert len(found) == 1 and words in found[0], found


def test_who_was_trained_with_the_limits_is_told_nothing(config: RunConfig) -> None:
    robot = shape(acceleration={"linear": 1.0, "angular": 2.0})
    trained = load_config("lndrl", ["world.robot=turtlebot2"])
    assert differences(robot, trained) == []
    assert len(differences(robot, config)) == 1
    # What world_of says is such a training.
    data = config.model_dump(mode="json")
    data["world"] |= world_of(robot)
    assert differences(robot, validate(RunConfig, data, "here")) == []


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"radius": None}, "either radius or footprint"),
        ({"footprint": [[0, 0], [1, 0], [0, 1]]}, "either radius or footprint"),
        ({"radius": 0.0}, "radius = 0.0: input should be greater than 0"),
        ({"speeds": 3}, "unknown key speeds; did you mean speed?"),
        ({"scanner": {"range_min": 12.0}}, "range_max 12 m must be above range_min 12 m"),
        ({"scanner": {"yaw": 90.0}}, "angles are in radians, and 90 degrees are 1.571"),
        ({"topics": {"scan": "my scan"}}, "'my scan' is no topic"),
        ({"latency": 9.0}, "latency = 9.0"),
    ],
)
def test_a_wrong_file_is_one_sentence(changes: dict, sentence: str) -> None:
    with pytest.raises(UserError) as caught:
        shape(**changes)
    assert sentence in str(caught.value)


def test_a_file_of_one_s_own(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(PLAIN))
    assert load_shape(path) == shape()
    with pytest.raises(UserError, match="did you mean turtlebot"):
        load_shape("turtlebot1")
