"""What is missing, stale or cannot be: every reason has a name, and the robot stands by it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lndrl.robot.driving.assembly import DriveOptions
from lndrl.robot.messages import GridMap, Scan, StampedPose
from tests.lndrl.robot.rig import Rig, driving, stands, without


# What is missing from the start.
@pytest.mark.parametrize(
    ("missing", "reason"),
    [("map", "no_map"), ("initial_pose", "no_pose"), ("goal", "no_goal"),
     ("tf_static", "no_scanner_pose")],
)  # fmt: skip
def test_what_is_missing_is_named(missing: str, reason: str) -> None:
    rig = Rig().begin(without=[missing]).tick(5)
    assert reason in rig.reasons and set(rig.commands) <= {(0.0, 0.0)}


@pytest.mark.parametrize(("missing", "reason"), [("scan", "no_scan"), ("odometry", "no_odometry")])
def test_sensors_that_never_speak_are_named(missing: str, reason: str) -> None:
    rig = Rig().begin().tick(5, without(missing))
    assert reason in rig.reasons and set(rig.commands) <= {(0.0, 0.0)}


# What becomes stale.
@pytest.mark.parametrize(
    ("silent", "reason"), [("scan", "scan_stale"), ("odometry", "odometry_stale")]
)
def test_a_stale_sensor_stops_within_a_control_period_and_comes_back(
    silent: str, reason: str
) -> None:
    rig = driving()
    silent_since = rig.now - 0.1
    while rig.driver.command != (0.0, 0.0):
        rig.tick(1, without(silent)) if silent == "odometry" else rig.quiet(0.02)
        assert rig.now - silent_since <= rig.pilot.period + 0.11
    stands(rig, reason)
    rig.tick(8)
    assert rig.reasons == [] and rig.driver.command != (0.0, 0.0)
    assert rig.driver.tally.stops[reason] == 1


def test_people_who_are_no_longer_tracked_stop_it() -> None:
    rig = driving().tick(13, without("people"))
    stands(rig, "people_stale")
    alone = Rig(DriveOptions(people=False)).begin().tick(20, without("people"))
    assert alone.reasons == []


def test_a_late_message_is_as_old_as_its_stamp() -> None:
    rig = driving()
    scan, late = rig.body.scan(rig.stamp), rig.now
    rig.say("odometry", rig.body.odometry(rig.stamp))
    rig.now += 0.6
    rig.say("odometry", replace(rig.body.odometry(rig.stamp)))
    rig.say("scan", scan)  # which is 0.6 s old now
    rig.driver.watch(rig.now)
    assert rig.now - late == pytest.approx(0.6)
    stands(rig, "scan_stale")


# What cannot be.
def changed(purpose_changed: str, **changes: Any) -> Any:
    def alter(purpose: str, content: Any) -> Any:
        return replace(content, **changes) if purpose == purpose_changed else content

    return alter


def silenced(value: float) -> Any:
    def alter(purpose: str, content: Any) -> Any:
        if isinstance(content, Scan):
            return replace(content, ranges=np.full_like(content.ranges, value))
        return content

    return alter


@pytest.mark.parametrize(
    ("alter", "reason"),
    [
        (silenced(np.nan), "scan_blind"),
        (silenced(0.0), "scan_blind"),
        (changed("scan", angle_increment=0.0), "scan_invalid"),
        (changed("scan", angle_min=np.nan), "scan_invalid"),
        (changed("scan", range_max=0.0), "scan_invalid"),
        (changed("scan", ranges=np.ones(1, np.float32)), "scan_invalid"),
        (changed("scan", ranges=np.ones(100, np.float32)), "scan_changed"),
        (changed("scan", range_max=30.0), "scan_changed"),
        (changed("scan", frame="elsewhere"), "no_scanner_pose"),
        (changed("people", frame="camera"), "people_frame"),
        (changed("odometry", pose=np.array([np.nan, 0.0, 0.0])), "odometry_invalid"),
        (changed("odometry", pose=np.array([50.0, 0.0, 0.0])), "odometry_jumped"),
    ],
)  # fmt: skip
def test_what_cannot_be_true_stops_at_once(alter: Any, reason: str) -> None:
    rig = driving().tick(1, alter)
    stands(rig, reason)
    assert all("\n" not in str(stop) for stop in rig.driver.stops)


def test_a_scan_that_changes_once_goes_on() -> None:
    rig = driving()

    def fewer(purpose: str, content: Any) -> Any:
        return replace(content, ranges=content.ranges[:400]) if purpose == "scan" else content

    rig.tick(1, fewer)
    stands(rig, "scan_changed")
    rig.tick(6, fewer)
    assert rig.reasons == []


def test_some_readings_of_nothing_are_no_echoes() -> None:
    rig = driving()

    def holes(purpose: str, content: Any) -> Any:
        if purpose != "scan":
            return content
        ranges = content.ranges.copy()
        ranges[::3], ranges[1::7] = np.nan, 0.0
        return replace(content, ranges=ranges)

    rig.tick(40, holes)
    assert rig.reasons in ([], ["arrived"]) and rig.pose_error < 0.3


def test_a_jump_of_the_odometry_is_forgiven_when_somebody_gives_the_pose() -> None:
    rig = driving()
    rig.tick(1, changed("odometry", pose=np.array([50.0, 0.0, 0.0])))
    stands(rig, "odometry_jumped")
    rig.tick(5)
    assert "odometry_jumped" in rig.reasons and rig.driver.command == (0.0, 0.0)
    rig.say("initial_pose", StampedPose(0, "map", rig.body.pose_true.copy()))
    rig.tick(5)
    assert rig.reasons == [] and rig.pose_error < 0.3


@pytest.mark.parametrize("offset", [-5.0, 5.0])
def test_clocks_that_disagree(offset: float) -> None:
    rig = driving()
    for _ in range(3):
        for purpose, content in (
            ("odometry", rig.body.odometry(rig.stamp)), ("scan", rig.body.scan(rig.stamp)),
        ):  # fmt: skip
            rig.say(purpose, content, stamped=rig.now + offset)
        rig.now += 0.1
    stands(rig, "clocks_disagree")


def test_scan_and_odometry_of_two_clocks() -> None:
    rig = driving()
    for _ in range(12):
        behind = replace(rig.body.odometry(rig.stamp), stamp=rig.stamp - 10**9 // 2)
        rig.driver.take("odometry", behind, rig.now, None)
        rig.driver.take("scan", rig.body.scan(rig.stamp), rig.now, None)
        rig.driver.watch(rig.now)
        rig.now += 0.1
    stands(rig, "clocks_disagree")


def test_time_that_goes_back() -> None:
    rig = driving()
    rig.say("odometry", replace(rig.body.odometry(rig.stamp), stamp=rig.stamp - 20 * 10**9))
    rig.driver.watch(rig.now)
    stands(rig, "time_jumped")


# Maps, poses, goals.
def test_maps_that_are_none() -> None:
    rig = driving()
    good = rig.body.map(rig.stamp)
    for bad in (
        replace(good, cells=good.cells.reshape(-1)[:-3]),
        replace(good, resolution=0.0),
        replace(good, cells=np.full_like(good.cells, -1)),
        replace(good, origin=np.array([np.nan, 0.0, 0.0])),
        replace(good, cells=np.zeros((0, 0), np.int8)),
    ):
        rig.say("map", bad)
        rig.driver.watch(rig.now)
        stands(rig, "map_invalid")
        rig.say("map", good)
        rig.tick(5)
        assert rig.reasons == []
    rig.say("map", replace(good, frame="other_map"))
    rig.driver.watch(rig.now)
    stands(rig, "map_frame")


def test_a_map_whose_origin_is_moved_and_turned() -> None:
    rig = Rig()
    stamp = rig.stamp
    good: GridMap = rig.body.map(stamp)
    turn = np.array([3.0, -2.0, 0.7])
    c, s = np.cos(0.7), np.sin(0.7)
    x, y, yaw = rig.body.start
    pose = np.array([3.0 + c * x - s * y, -2.0 + s * x + c * y, yaw + 0.7])
    goal = np.array([3.0, -2.0]) + np.array([[c, -s], [s, c]]) @ rig.body.goal
    rig.say("tf_static", rig.body.mounting(stamp))
    rig.say("map", replace(good, origin=turn))
    rig.say("initial_pose", StampedPose(stamp, "map", pose))
    rig.say("goal", StampedPose(stamp, "map", np.array([*goal, 0.0])))
    rig.tick(30)
    estimate = rig.driver.senses.estimate
    assert estimate is not None and rig.reasons == []
    x, y, _ = rig.body.pose_true
    true = np.array([3.0 + c * x - s * y, -2.0 + s * x + c * y])
    assert np.hypot(*(estimate.pose[:2] - true)) < 0.35


@pytest.mark.parametrize(
    ("goal", "frame", "reason"),
    [
        ((0.02, 3.0), "map", "goal_in_wall"),
        ((6.5, 1.2), "map", "goal_in_wall"),
        ((-3.0, 1.0), "map", "goal_off_map"),
        ((np.nan, 1.0), "map", "goal_off_map"),
        ((2.0, 2.0), "camera", "goal_frame"),
    ],
)
def test_goals_that_cannot_be(goal: Any, frame: str, reason: str) -> None:
    rig = driving()
    rig.say("goal", StampedPose(rig.stamp, frame, np.array([*goal, 0.0])))
    rig.tick(2)
    stands(rig, reason)
    rig.say("goal", rig.body.goal_pose(rig.stamp))
    rig.tick(3)
    assert rig.reasons == []


def test_a_goal_behind_a_wall() -> None:
    rig = Rig().begin(without=["map", "goal"])
    cells = rig.body.map(0).cells.copy()
    cells[:, 80:84] = 100
    rig.say("map", replace(rig.body.map(0), cells=cells))
    rig.say("goal", rig.body.goal_pose(0))
    rig.tick(3)
    stands(rig, "goal_unreachable")


def test_goals_in_other_frames_are_found() -> None:
    rig = driving()
    rig.say("goal", StampedPose(rig.stamp, "base_link", np.array([1.5, 0.0, 0.0])))
    rig.tick(2)
    goal = rig.driver.view(rig.now).goal
    assert goal is not None
    ahead = goal - rig.body.pose_true[:2]
    assert np.hypot(*ahead) == pytest.approx(1.5, abs=0.4)


def test_poses_that_cannot_be() -> None:
    rig = driving()
    for pose, frame, reason in (
        ([np.nan, 0.0, 0.0], "map", "pose_invalid"), ([90.0, 0.0, 0.0], "map", "pose_invalid"),
        ([2.0, 2.0, 0.0], "odom", "pose_frame"),
    ):  # fmt: skip
        rig.say("initial_pose", StampedPose(rig.stamp, frame, np.array(pose)))
        rig.driver.watch(rig.now)
        stands(rig, reason)
    rig.say("initial_pose", StampedPose(rig.stamp, "map", rig.body.pose_true.copy()))
    rig.tick(4)
    assert rig.reasons == []


def test_a_wrong_pose_is_found_out_while_it_drives() -> None:
    rig = Rig().begin(without=["initial_pose"])
    wrong = np.array([7.5, 3.0, rig.body.start[2] + 1.5])
    spread = np.diag([0.001, 0.001, 0.001])
    rig.say("initial_pose", StampedPose(rig.stamp, "map", wrong, spread))
    seen = []
    for _ in range(150):
        rig.tick()
        seen += rig.reasons
        if {"pose_lost", "pose_inconsistent"} & set(seen) or rig.pose_error < 0.3:
            break
    told = {"pose_lost", "pose_inconsistent"} & set(seen)
    assert told or rig.pose_error < 0.3, "it is told, or it has found itself"


def test_the_robots_own_pose_carries_it() -> None:
    rig = Rig(DriveOptions(localization="robot"), localizes=True).begin().tick(30)
    assert rig.reasons == [] and rig.pose_error < 0.3
    silent = without("robot_pose")
    while rig.reasons == [] and rig.now < 130.0:
        rig.tick(1, silent)
    assert rig.reasons in (["pose_stale"], ["arrived"])
