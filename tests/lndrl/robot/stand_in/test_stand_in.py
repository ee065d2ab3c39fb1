"""The stand-in's world, what it says, and what befalls it on the way."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.evaluation import EpisodeRunner
from lndrl.localization import Scanner
from lndrl.planners import planner_source
from lndrl.robot import geometry
from lndrl.robot.driving.odometry import Wheels
from lndrl.robot.driving.skew import at_one_moment
from lndrl.robot.messages import SECOND, Clock, Odometry, Scan, StampedPose, Transforms
from lndrl.robot.shapes import load_shape, rehearsed
from lndrl.robot.stand_in import Body, Conditions, Mute, Rehearsal
from lndrl.robot.stand_in.conditions import Outbox
from lndrl.robot.stand_in.judge import Judge
from tests.lndrl.robot.rig import config_of

FIRST, TICK = 10 * SECOND, SECOND // 10


def test_episodes_are_those_of_evaluate() -> None:
    config = config_of(delay=0)
    starts = []
    runner = EpisodeRunner(planner_source("straight"), config)
    list(runner([0, 1], lambda world: starts.append((world.world.start_pose, world.world.goal))))
    body = Body(config)
    for episode in (0, 1):
        body.begin(episode)
        pose, goal = starts[episode]
        assert np.array_equal(body.start, pose) and np.array_equal(body.goal, goal)


def test_what_sensors_say_fits_together() -> None:
    scanner = Scanner(0.1, 0.0, 0.3, upside_down=True)
    plain, mounted = Body(config_of(odom_alpha1=0.1)), Body(config_of(), scanner)
    for body in (plain, mounted):
        body.begin(0)
        for _ in range(8):
            body.tick(0.4, 0.3)
    odometry, tf = plain.odometry(5), plain.transforms(5)
    assert (odometry.frame, odometry.child, odometry.stamp) == ("odom", "base_link", 5)
    at = tf.transforms[0].translation[:2]
    assert np.allclose(at, odometry.pose[:2])
    people = plain.people(5)
    frame = geometry.chained(odometry.pose, geometry.inverse(plain.pose_true))
    there = geometry.moved_points(geometry.inverse(frame), people.position)
    assert np.allclose(there, plain.world.pedestrian_position)
    grid = plain.map(5)
    assert grid.cells.shape == plain.place.grid.shape and set(np.unique(grid.cells)) == {0, 100}
    scan = mounted.scan(5)
    first, last = scan.angle_min, scan.angle_min + scan.angle_increment * 719
    assert first == pytest.approx(-np.pi / 2 + np.pi / 720) and last == pytest.approx(np.pi / 2)
    assert np.isinf(scan.ranges).any() or (scan.ranges < 12.0).all()


def test_a_robot_of_a_file_drives_and_sees_as_that_says() -> None:
    shape = load_shape("turtlebot2")
    config = rehearsed(shape, config_of())
    body = Body(config, shape.scanner.scanner(), fastest=(0.25, 3.14))
    body.begin(0)
    assert body.config.world.robot_radius == 0.18
    for k in range(4):
        body.tick(0.6, 0.0)
        assert body.odometry(k).velocity[0] == pytest.approx(min(0.1 * (k + 1), 0.25))
    scan = body.scan(9)
    assert (len(scan.ranges), scan.range_min, scan.range_max) == (1600, 0.2, 12.0)
    assert scan.angle_increment * 1600 == pytest.approx(2.0 * np.pi)
    near = scan.ranges[scan.ranges <= np.float32(0.2)]
    assert (near == 0.0).all(), "what is too near is no echo"


def test_its_own_filter_knows_how_the_scanner_stands() -> None:
    for scanner in (Scanner(0.15, 0.0, 2.0), Scanner(-0.1, 0.05, np.pi, upside_down=True)):
        body = Body(config_of(), scanner, localizes=True)
        body.begin(0)
        for _ in range(20):
            body.tick(0.3, 0.2)
            body.scan(0)
        pose = body.own_pose(3)
        assert pose is not None and np.hypot(*(pose.pose - body.pose_true)[:2]) < 0.3


def test_a_robot_that_is_carried_to_the_next_start_notices_nothing() -> None:
    body = Body(config_of())
    body.begin(0)
    for _ in range(6):
        body.tick(0.5, 0.4)
    before = body.odometry(1).pose
    body.begin(1)
    assert np.allclose(body.odometry(2).pose, before)
    body.tick(0.5, 0.0)
    assert np.hypot(*(body.odometry(3).pose - before)[:2]) < 0.1


def test_its_own_localization_is_told_as_amcl_tells_it() -> None:
    body = Body(config_of(), localizes=True)
    body.begin(0)
    for _ in range(20):
        body.tick(0.3, 0.2)
        body.scan(0)
    pose = body.own_pose(3)
    assert pose is not None and np.hypot(*(pose.pose - body.pose_true)[:2]) < 0.3
    by_tf = {(each.parent, each.child): each for each in body.transforms(3).transforms}
    assert set(by_tf) == {("odom", "base_link"), ("map", "odom")}


@pytest.mark.parametrize("mount", [None, Scanner(0.1, -0.1, 0.5, upside_down=True)])
def test_a_scanner_that_turns_while_it_drives(mount: Scanner | None) -> None:
    still, swept = Body(config_of(), mount), Body(config_of(), mount, sweeps=True)
    wheels = Wheels()
    for body in (still, swept):
        body.begin(0)
        for _ in range(6):
            body.tick(0.4, 0.9)
    # The swept scan began a tick ago, where the other robot stands.
    wheels.add(Odometry(FIRST, "", "", swept.world.pose_true.copy()))
    swept.tick(0.4, 0.9)
    wheels.add(Odometry(FIRST + TICK, "", "", swept.world.pose_true.copy()))
    scans = [still.scan(FIRST), swept.scan(FIRST + TICK)]
    assert scans[1].stamp == FIRST and scans[0].time_increment == 0.0
    assert scans[1].time_increment * len(scans[1].ranges) == pytest.approx(0.1)
    made = at_one_moment(scans[1], swept.scanner, wheels)
    both = np.isfinite(scans[0].ranges) & np.isfinite(made.ranges) & np.isfinite(scans[1].ranges)
    # Noise is some centimetres on either side; people walk and edges are ragged.
    truth = scans[0].ranges[both]
    before, after = (np.abs(each.ranges[both] - truth) for each in (scans[1], made))
    assert np.quantile(after, 0.75) < 0.7 * np.quantile(before, 0.75) and both.sum() > 200


def scan(stamp: int) -> Scan:
    return Scan(stamp, "l", 0.0, 0.1, 0.1, 9.0, np.ones(3, np.float32))


def test_messages_are_late_lost_and_wrongly_stamped() -> None:
    late = Outbox(Conditions(delay=0.2, clock_offset=3.0), 0)
    late.add("scan", scan(SECOND), 1.0)
    assert late.due(1.1) == []
    ((purpose, content),) = late.due(1.2)
    assert purpose == "scan" and isinstance(content, Scan) and content.stamp == 4 * SECOND
    lossy = Outbox(Conditions(loss=0.3), 1)
    for k in range(2000):
        lossy.add("scan", scan(k), 0.01 * k)
    assert 0.65 < len(lossy.due(99.0)) / 2000 < 0.75
    uneven = Outbox(Conditions(delay=0.3, jitter=0.1), 2)
    for k in range(200):
        uneven.add("scan", scan(k), 0.1 * k)
    stamps = [content.stamp for _, content in uneven.due(99.0)]  # type: ignore[union-attr]
    assert sorted(stamps) == list(range(200)) and stamps != sorted(stamps)
    mute = Outbox(Conditions(mutes=(Mute("scan", 1.0, 2.0),)), 3)
    for time in (0.5, 1.5, 3.5):
        mute.add("scan", scan(round(time * 10)), time)
        mute.add("odometry", Odometry(0, "", "", np.zeros(3)), time)
    assert [purpose for purpose, _ in mute.due(9.0)].count("scan") == 2
    moved = Outbox(Conditions(clock_offset=-1.0), 0)
    moved.add("tf", Transforms(()), 0.0)
    moved.add("clock", Clock(SECOND), 0.0)
    assert moved.due(1.0) == [("tf", Transforms(())), ("clock", Clock(0))]


@pytest.mark.parametrize(
    ("given", "words"),
    [({"delay": -1.0}, "delay -1"), ({"loss": 1.5}, "loss 1.5"), ({"jitter": np.nan}, "jitter")],
)
def test_conditions_that_cannot_be(given: dict[str, float], words: str) -> None:
    with pytest.raises(UserError, match=words):
        Conditions(**given)  # type: ignore[arg-type]


def test_rehearsals_that_cannot_be() -> None:
    for given, words in (
        ({"pace": None}, "time must be simulated"), ({"pace": 0.0}, "pace 0"),
        ({"episodes": 0}, "episodes 0"), ({"command_timeout": 0.0}, "command_timeout 0"),
    ):  # fmt: skip
        with pytest.raises(UserError, match=words):
            Rehearsal(**given)


def test_episodes_end_by_the_rules_of_evaluate() -> None:
    body = Body(config_of())
    body.begin(0)
    judge = Judge(body, 0)
    judge.sensed(10)

    def told(pose: np.ndarray, stamp: int = 10) -> StampedPose:
        return StampedPose(stamp, "map", pose)

    assert judge.verdict(None, False) is None and judge.verdict(told(body.start), False) is None
    assert judge.verdict(told(body.start), True) == "collided"
    assert judge.verdict(told(np.add(body.start, [2.1, 0.0, 0.0])), False) == "lost"
    assert judge.verdict(told(np.add(body.start, [0.0, 0.0, 0.8])), False) == "lost"
    at_goal = np.array([*body.goal, body.start[2]])
    assert np.hypot(*(at_goal - body.start)[:2]) > 2.0
    body.world.pose_true[:] = at_goal
    judge.sensed(20)
    assert judge.verdict(told(at_goal, 20), False) == "arrived"
    assert judge.verdict(told(body.start, 11), False) is None, "by the moment that it speaks of"
    for _ in range(body.steps_limit * 4):
        body.tick(0.0, 0.0)
    assert judge.verdict(told(body.start, 11), False) == "timeout"
    assert Judge(body, 0, limited=False).verdict(None, False) is None
    record = judge.record("arrived")
    assert record.stood
    body.tick(0.3, 0.0)
    assert not judge.record("collided").stood
    assert record.steps == body.steps_limit and record.to_dict()["outcome"] == "arrived"
