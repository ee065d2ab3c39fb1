"""A driver in a closed loop with a world: it arrives, keeps its limits, and says what it does."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.localization import Scanner
from lndrl.robot.driving import Limits, Reason
from lndrl.robot.driving.assembly import DriveOptions, drive_config
from lndrl.robot.geometry import rotation
from lndrl.robot.messages import Joystick, StampedPose, Switch, Transform, Transforms
from tests.lndrl.robot.rig import Rig, config_of, driving, stands


def test_it_arrives_and_stands() -> None:
    rig = Rig().begin()
    for _ in range(200):
        rig.tick()
        if rig.driver.arrived:
            break
    assert np.hypot(*(rig.body.pose_true[:2] - rig.body.goal)) < 0.7 and not rig.touched
    assert rig.reasons == ["arrived"] and rig.driver.tally.arrivals == 1
    assert rig.pose_error < 0.3
    stands(rig, "arrived")
    before = len(rig.commands)
    rig.tick(30)
    zeros = rig.commands[before:]
    assert 5 <= len(zeros) <= 11 and set(zeros) == {(0.0, 0.0)}, "for a second, then others may"
    rig.say("goal", StampedPose(0, "map", np.array([2.0, 2.0, 0.0])))
    rig.tick(2)
    assert rig.reasons == []


def test_it_decides_once_a_control_period_and_commands_with_every_scan() -> None:
    rig = driving()
    decisions, commands = rig.driver.tally.decisions, len(rig.commands)
    rig.tick(20)
    assert rig.driver.tally.decisions - decisions == 5
    assert len(rig.commands) - commands == 20


def test_a_policy_drives_and_says_what_it_thinks_of() -> None:
    rig = Rig(planner="shipped").begin().tick(30)
    assert rig.reasons == []
    probabilities = rig.driver.view(rig.now).probabilities
    assert probabilities is not None and probabilities.sum() == pytest.approx(1.0, abs=1e-5)
    assert rig.driver.decision is not None and len(rig.driver.decision.people) <= 2
    assert np.hypot(*(rig.body.pose_true - rig.body.start)[:2]) > 0.2


def test_a_planner_that_knows_the_map_drives() -> None:
    rig = Rig(planner="careful+map").begin().tick(9)
    assert rig.reasons == [] and rig.driver.command != (0.0, 0.0)


@pytest.mark.parametrize("localization", ["own", "robot"])
@pytest.mark.parametrize(
    "scanner", [Scanner(), Scanner(0.1, -0.05, 0.4), Scanner(-0.1, 0.0, np.pi, upside_down=True)]
)
def test_wherever_the_scanner_is(localization: Any, scanner: Scanner) -> None:
    rig = Rig(DriveOptions(localization=localization), scanner=scanner,
              localizes=localization == "robot")  # fmt: skip
    rig.begin().tick(40)
    assert rig.pose_error < 0.3 and rig.reasons == []


def test_a_scanner_as_measured_by_hand() -> None:
    rig = Rig(
        DriveOptions(scanner=Scanner(0.1, 0.0, 0.5, True)), scanner=Scanner(0.1, 0.0, 0.5, True)
    )
    rig.begin(without=["tf_static"]).tick(40)
    assert rig.pose_error < 0.3 and rig.reasons == []


# The deadman, limits, planners that fail, the end.
def test_a_deadman_must_be_held() -> None:
    rig = Rig(DriveOptions(enable_topic="/enable")).begin().tick(3)
    stands(rig, "not_enabled")
    for _ in range(5):
        rig.say("enable", Switch(True))
        rig.tick()
    assert rig.reasons == []
    rig.tick(7)
    stands(rig, "not_enabled")
    rig.say("enable", Switch(True))
    rig.tick(2)
    rig.say("enable", Switch(False))
    rig.driver.watch(rig.now)
    stands(rig, "not_enabled")


def test_a_joystick_is_a_deadman() -> None:
    rig = Rig(DriveOptions(enable_topic="/joy", enable_button=1)).begin()
    for buttons, held in (((1, 0), False), ((0, 1), True), ((0,), False)):
        rig.say("enable", Joystick(0, buttons))
        rig.tick(1)
        assert ("not_enabled" not in rig.reasons) == held


def test_speeds_and_accelerations_are_kept() -> None:
    limits = Limits(speed=0.3, turn=0.5, acceleration=0.5, turn_acceleration=1.0)
    rig = Rig(DriveOptions(limits=limits)).begin().tick(40)
    commands = np.array(rig.commands)
    assert np.abs(commands[:, 0]).max() == pytest.approx(0.3)
    assert np.abs(commands[:, 1]).max() <= 0.5
    moving = commands[: np.flatnonzero(commands[:, 0])[-1] + 1]
    assert np.diff(moving[:, 0]).max() <= 0.05 + 1e-9
    assert np.abs(np.diff(moving[:, 1])).max() <= 0.1 + 1e-9
    assert limits.notes((0.6, 0.9))[0].startswith("the policy may drive at 0.6 m/s")
    with pytest.raises(UserError, match="limit speed -1: must be above 0"):
        Limits(speed=-1.0)


def test_a_stop_does_not_wait_for_the_acceleration() -> None:
    rig = Rig(DriveOptions(limits=Limits(acceleration=0.2))).begin().tick(20)
    assert rig.driver.command[0] > 0.1
    rig.quiet(0.5)
    stands(rig, "scan_stale")


@pytest.mark.parametrize("wrong", [RuntimeError("broken\nin two lines"), UserError("no way")])
def test_a_planner_that_fails_stops_it(wrong: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = driving()

    def fail(*_: Any) -> Any:
        raise wrong

    monkeypatch.setattr(rig.pilot.planner, "act", fail)
    rig.tick(5)
    stands(rig, "planner_failed")
    assert "\n" not in str(rig.driver.stops[0])


def test_a_planner_that_answers_nonsense_stops_it(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = driving()
    monkeypatch.setattr(rig.pilot.planner, "act", lambda *_: np.array([[np.nan, 0.0]]))
    rig.tick(5)
    stands(rig, "planner_failed")


def test_the_end_is_a_stop() -> None:
    rig = driving()
    rig.driver.stand(rig.now, "ended")
    stands(rig, "interrupted")
    rig.tick(5)
    assert set(rig.commands[-3:]) == {(0.0, 0.0)}


def test_every_stop_is_published_when_it_changes() -> None:
    rig = driving()
    rig.sent.clear()
    rig.quiet(0.6)
    said = [json.loads(content.text) for purpose, content in rig.sent if purpose == "status"]
    assert [each["reason"] for each in said] == ["scan_stale"]
    assert said[0]["state"] == "standing" and "s old" in said[0]["words"]
    assert said[0]["all"] == ["scan_stale", "odometry_stale"]


def test_the_belief_is_published_for_rviz() -> None:
    rig = driving()
    rig.sent.clear()
    rig.tick(10)
    poses = [content for purpose, content in rig.sent if purpose == "own_pose"]
    clouds = [content for purpose, content in rig.sent if purpose == "particles"]
    assert len(poses) == 10 and poses[0].frame == "map" and poses[0].covariance is not None
    assert len(clouds) == 2 and 50 <= len(clouds[0].poses) <= 500


def test_reasons_are_documented_by_what_to_do() -> None:
    assert all(reason.value and not reason.value.endswith(".") for reason in Reason)


def test_filters_that_no_robot_has() -> None:
    with pytest.raises(UserError, match="--filter bset: is unknown; known: paper, best"):
        drive_config(config_of(), DriveOptions(preset="bset"))
    assert drive_config(config_of(), DriveOptions(preset="best")).localization.preset == "best"
    config = config_of(kind="perfect")
    with pytest.raises(UserError, match="never known exactly"):
        drive_config(config, DriveOptions())


def test_people_are_seen_where_they_are() -> None:
    rig = driving()
    people = rig.driver.senses.people()
    assert people is not None
    c, s = np.cos(rig.body.pose_true[2]), np.sin(rig.body.pose_true[2])
    turned = np.array([[c, -s], [s, c]])
    there = rig.body.pose_true[:2] + people.position @ turned.T
    # The last tick has moved everybody since.
    assert np.abs(there - rig.body.world.pedestrian_position).max() < 0.35
    velocity = people.velocity @ turned.T
    assert np.abs(velocity - rig.body.world.pedestrian_velocity).max() < 0.5


def test_a_tf_tree_leads_to_the_scanner() -> None:
    rig = Rig(scanner=Scanner(0.1, 0.0, 0.3))
    up = np.array([0.0, 0.0, 0.1])
    chain = Transforms(
        (
            Transform(0, "base_link", "plate", up, rotation(0.3)),
            Transform(0, "plate", "base_scan",
                      np.array([0.1 * np.cos(0.3), -0.1 * np.sin(0.3), 0.0]), np.eye(3)),
        )
    )  # fmt: skip
    rig.begin(without=["tf_static"]).say("tf_static", chain)
    rig.tick(30)
    assert rig.reasons == [] and rig.pose_error < 0.3
