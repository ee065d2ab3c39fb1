"""The guard of a drive: what it holds back, says and counts; and what a robot's file says to it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.localization import Scanner
from lndrl.planners import GuardConfig
from lndrl.planners.predictive import PredictivePlanner
from lndrl.robot.driving import Limits
from lndrl.robot.driving.assembly import DriveOptions
from lndrl.robot.driving.guarding import DriveGuard
from lndrl.robot.driving.senses import Trust
from lndrl.robot.fitting import (
    fitted_limits,
    fitted_topics,
    guard_bounds,
    guard_words,
    guarded_base,
)
from lndrl.robot.messages import Scan
from lndrl.robot.shapes import load_shape, planned_for, rehearsed
from tests.lndrl.robot.rig import Rig, config_of, without

GUARD = DriveOptions(guard=GuardConfig(delay=0.1))


def somebody(away: float, bearing: float = 0.0, half: float = 0.15) -> Any:
    """Lets the scan show somebody ``away`` m ahead, or at ``bearing`` (rad)."""

    def alter(purpose: str, content: Any) -> Any:
        if not isinstance(content, Scan):
            return content
        angle = content.angle_min + content.angle_increment * np.arange(len(content.ranges))
        ranges = np.where(np.abs(angle - bearing) < half, np.float32(away), content.ranges)
        return replace(content, ranges=ranges.astype(np.float32))

    return alter


def ready(options: DriveOptions = GUARD, **given: Any) -> Rig:
    """A robot with somebody in its way, who lets it believe where it is before it may drive."""
    return Rig(options, **given).begin()


def test_it_stands_before_somebody_and_goes_on_when_they_leave() -> None:
    rig = ready().tick(12)
    assert rig.reasons == [] and rig.driver.command[0] > 0.3
    rig.tick(12, somebody(0.6))
    assert rig.driver.command[0] == 0.0 and rig.driver.guarded
    assert "what may move is 0." in rig.driver.guarded and "ahead" in rig.driver.guarded
    assert rig.driver.tally.guarded >= 2
    rig.tick(8)
    assert rig.driver.command[0] > 0.3 and not rig.driver.guarded


def test_its_refusal_has_a_name_that_is_published_and_counted() -> None:
    rig = ready().tick(14)
    rig.sent.clear()
    rig.tick(12, somebody(0.6))
    assert rig.reasons == ["guarded"] and rig.commands[-1] == (0.0, 0.0)
    said = [json.loads(content.text) for purpose, content in rig.sent if purpose == "status"][-1]
    assert said["state"] == "standing" and said["reason"] == "guarded" and said["guard"] == "on"
    assert said["guarded"] and said["health"]["echoes"] > 5
    assert rig.driver.tally.stops["guarded"] == 1
    assert rig.driver.view(rig.now).stops[0].reason.label == "guarded"
    rig.quiet(0.5)
    assert "scan_stale" in rig.reasons and not rig.driver.guarded, "what is wrong comes first"


def test_who_walks_faster_than_it_counts_on_is_told() -> None:
    rig = ready().tick(8)
    assert rig.driver.status()["doubt"] == ""

    def hurried(purpose: str, content: Any) -> Any:
        if purpose != "people":
            return content
        return replace(content, velocity=np.full_like(content.velocity, 1.0))

    rig.tick(2, hurried)
    assert rig.driver.status()["doubt"] == "somebody walks 1.4 m/s"
    assert rig.driver.view(rig.now).doubt == "somebody walks 1.4 m/s"
    assert Rig().begin().tick(2, hurried).driver.status()["doubt"] == "", "there is no guard"


def test_without_it_the_robot_drives_on() -> None:
    rig = ready(DriveOptions()).tick(12)
    rig.tick(8, somebody(0.6))
    assert rig.driver.command[0] > 0.3 and not rig.driver.guarded
    assert rig.driver.status()["guard"] == "off"


def test_what_it_takes_instead_keeps_to_the_limits() -> None:
    limits = Limits(speed=0.25, turn=0.4, acceleration=0.5, turn_acceleration=1.0)
    rig = ready(DriveOptions(guard=GuardConfig(), limits=limits)).tick(24)
    rig.tick(24, somebody(0.85))
    commands = np.array(rig.commands)
    assert np.abs(commands[:, 0]).max() <= 0.25 and np.abs(commands[:, 1]).max() <= 0.4
    moving = commands[commands.any(axis=1)]
    assert rig.driver.tally.guarded > 0 and len(moving) > 10
    assert np.diff(moving[:, 0]).max() <= 0.05 + 1e-9


def test_an_old_scan_asks_for_more_room() -> None:
    """While no scan comes, what holds is looked at again, and people may have come nearer."""
    far = next(x for x in np.arange(1.6, 2.0, 0.05) if not held_at(x))
    assert not held_at(far)
    rig = ready().tick(12).tick(2, somebody(far)).quiet(0.2)
    assert rig.driver.guarded and rig.reasons in ([], ["guarded"])


def held_at(away: float) -> str:
    return ready().tick(12).tick(2, somebody(away)).driver.guarded


def test_a_scan_that_waits_for_its_odometry_is_not_what_it_sees() -> None:
    rig = ready().tick(6)
    before = rig.driver.senses.scan_age(rig.now)
    rig.tick(2, without("odometry"))
    age = rig.driver.senses.scan_age(rig.now)
    assert before is not None and age is not None and age >= before + 0.05


def test_it_takes_the_robot_for_as_fast_as_it_may_be_when_a_command_is_felt() -> None:
    base = guarded_base(load_shape("turtlebot2"), 0.18)
    guard = DriveGuard(GuardConfig(delay=0.15), base, np.array([(0.6, 0.9)]), 0.4)
    # What the wheels said is 0.2 s old: it has gained speed since then, too.
    rising = guard._ahead(np.zeros(2), (0.6, 0.0), 0.35)
    assert rising[:, 0] == pytest.approx([0.1, 0.2, 0.3, 0.4])
    # It was told to slow down, and may not have heard of it.
    assert guard._ahead(np.array([0.6, 0.0]), (0.2, 0.0), 0.15)[:, 0] == pytest.approx([0.6, 0.6])
    assert guard._limits[1] < base.limits[1], "brakes of a base that brakes evenly"


def test_what_is_too_old_to_foretell_by_is_not_driven_by() -> None:
    """However long somebody lets sensors be silent."""
    rig = ready(replace(GUARD, trust=Trust(stale=5.0, people_stale=9.0))).tick(12).quiet(1.0)
    assert rig.reasons == ["guarded"] and "s old when a command is felt" in rig.driver.guarded


def test_in_a_crowd_it_arrives_and_touches_nobody_while_it_moves() -> None:
    shape = load_shape("turtlebot2")
    config = rehearsed(shape, config_of())
    options = DriveOptions(
        guard=guard_bounds(shape, {}), robot=shape, limits=fitted_limits(Limits(), shape)
    )
    rig = Rig(options, config=config, scanner=shape.scanner.scanner()).begin()
    for _ in range(400):
        rig.tick()
        touched, moved = rig.touched, rig.driver.command[0] != 0.0
        assert not (touched and moved)
        if rig.driver.arrived:
            break
    assert rig.driver.arrived and rig.pose_error < 0.3


# What a robot's file says.
def test_a_robots_file_says_topics_limits_and_bounds() -> None:
    shape = load_shape("turtlebot2")
    topics = shape.topics.model_copy(update={"scan": "lidar", "people": "/people_found"})
    named = fitted_topics(shape.model_copy(update={"topics": topics}))
    assert (named.scan, named.people_poses, named.command) == (
        "/lidar",
        "/people_found",
        "/cmd_vel",
    )
    limits = fitted_limits(Limits(speed=0.3), shape)
    assert (limits.speed, limits.turn, limits.acceleration, limits.braking) == (0.3, 3.14, 1.0, 1.0)
    assert fitted_limits(Limits(acceleration=0.5), shape).braking is None, "as that"
    assert fitted_limits(Limits(speed=0.3), None) == Limits(speed=0.3)
    assert guard_bounds(shape, {}).delay == shape.latency
    assert guard_bounds(shape, {"delay": 0.4, "people_speed": 1.5}).delay == 0.4
    with pytest.raises(UserError, match="--guard-set"):
        guard_bounds(None, {"people": 1.0})


def test_of_a_robot_that_nobody_named_the_worst_is_taken() -> None:
    base = guarded_base(None, 0.17)
    assert base.limits == (math.inf, 1.0, math.inf) and base.timeout == 0.5
    assert guard_words(
        GuardConfig(), guarded_base(load_shape("turtlebot3-burger"), 0.1)
    ).startswith("people walk up to 0.5 m/s, it brakes by 2.5 m/s²")
    known = guarded_base(load_shape("turtlebot2"), 0.18)
    assert known.limits == (1.0, 1.0, 2.0) and known.timeout == 0.6
    assert guard_words(GuardConfig(delay=0.15), known) == (
        "people walk up to 0.5 m/s, it brakes by 1 m/s² and obeys within 0.15 s, all of it is "
        "within 0.18 m of its middle"
    )


def test_a_robots_scanner_is_believed_rather_than_tf() -> None:
    shape = load_shape("turtlebot4")
    config = rehearsed(shape, config_of())
    scanner = shape.scanner.scanner()
    rig = Rig(DriveOptions(robot=shape), config=config, scanner=scanner)
    rig.begin(without=["tf_static"]).tick(30)
    seen = rig.driver.senses.scan
    assert rig.reasons == [] and rig.pose_error < 0.3
    assert seen is not None and (seen.scanner.x, seen.scanner.range_min) == (-0.04, 0.164)
    assert rig.driver.senses.radius == 0.165
    assert rig.driver.status()["doubt"] == "", "nobody says otherwise"
    other = Rig(DriveOptions(robot=shape, scanner=Scanner(x=0.2)), config=config)
    assert other.begin().tick(3).driver.senses.scan.scanner.x == 0.2  # type: ignore[union-attr]
    assert other.driver.status()["doubt"] == "TF has the scanner at 0.00,0.00,0°"


def test_a_rule_plans_with_what_the_robot_can_and_how_fast_it_is() -> None:
    shape = load_shape("turtlebot2")
    config = planned_for(shape, config_of("predictive"))
    assert config.world.robot.acceleration.limits == (1.0, 1.0, 2.0)
    assert config.world.robot_radius == 0.18
    rig = Rig(planner="predictive", config=config).begin().tick(40)
    planner = rig.pilot.planner
    assert isinstance(planner, PredictivePlanner)
    heard: list[np.ndarray] = []
    planner.measured = lambda speeds, rows: heard.append(speeds[0])  # type: ignore[method-assign]
    rig.tick(8)
    wheels = rig.driver.senses.wheels.velocity
    assert len(heard) == 2 and np.abs(heard[-1] - wheels).max() < 0.25
    assert np.abs(np.array(heard) * 10.0 - np.round(np.array(heard) * 10.0)).max() < 1e-9
