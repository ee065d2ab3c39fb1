"""Drives from end to end: stand-in and driver over a real Zenoh link on loopback, both dialects."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Empty
from typing import Any

import numpy as np
import pytest

from lndrl.evaluation import settings_for
from lndrl.planners import planner_source
from lndrl.robot.driving import DriveService
from lndrl.robot.driving.assembly import DriveOptions, drive_config, make_service
from lndrl.robot.driving.pilot import Pilot
from lndrl.robot.link import Address, Link, Topic, open_link
from lndrl.robot.messages import StampedPose, Velocity, names
from lndrl.robot.recording import Recorder
from lndrl.robot.stand_in import Body, Conditions, DrivenEpisode, Rehearsal, StandIn
from lndrl.robot.topics import Topics
from lndrl.transport.zenoh.session import free_endpoint
from tests.lndrl.robot.rig import config_of

FAST = {"pace": None, "simulated": True, "patience": 20.0}


class Stage:
    """A stand-in in a thread, and a driver's link to it."""

    def __init__(self, link: Link, robot: Link, stand_in: StandIn) -> None:
        self.link, self.robot, self.stand_in = link, robot, stand_in
        self.stop = threading.Event()
        self.records: list[DrivenEpisode] = []
        self.thread = threading.Thread(target=self._play)
        self.thread.start()

    def _play(self) -> None:
        self.records = self.stand_in.run(self.stop)
        self.stop.set()

    def end(self) -> None:
        self.stop.set()
        self.thread.join()


@contextmanager
def stage(
    rehearsal: Rehearsal, dialect: str = "rmw", planner: str = "straight", **given: Any
) -> Iterator[Stage]:
    config = drive_config(config_of(planner), DriveOptions())
    endpoint = free_endpoint()
    with open_link(Address(endpoint, dialect, listen=True), "robot_sim") as robot:
        stand_in = StandIn(robot, Body(config, localizes=given.pop("amcl", False)), rehearsal,
                           **given)  # fmt: skip
        with open_link(Address(endpoint), "lndrl_drive") as link:
            played = Stage(link, robot, stand_in)
            try:
                yield played
            finally:
                played.end()


def service_on(
    played: Stage, options: DriveOptions | None = None, planner: str = "straight", **given: Any
) -> DriveService:
    options = options or DriveOptions()
    config = drive_config(config_of(planner), options)
    pilot = Pilot(planner_source(planner), config)
    return make_service(played.link, pilot, options, **given)


def within(seconds: float) -> Callable[[], bool]:
    end = time.monotonic() + seconds
    return lambda: time.monotonic() > end


@pytest.mark.parametrize(
    ("dialect", "stamped", "options", "people"),
    [
        ("rmw", False, DriveOptions(), "spencer"),
        ("bridge", True, DriveOptions(localization="robot"), "poses"),
    ],
)
def test_a_rehearsal_arrives(
    dialect: str, stamped: bool, options: DriveOptions, people: Any, tmp_path: Path
) -> None:
    rehearsal = Rehearsal(2, people=people, stamped=stamped, **FAST)  # type: ignore[arg-type]
    with stage(rehearsal, dialect, amcl=options.localization == "robot") as played:
        with Recorder(tmp_path / "drive.mcap", played.link.store) as recorder:
            service = service_on(played, options, recorder=recorder)
            assert service.wanted.simulated, "somebody publishes a clock"
            service.run(played.stop, over=within(100.0))
        played.thread.join(10.0)
    assert [record.outcome for record in played.records] == ["arrived", "arrived"]
    assert all(record.position_error < 0.4 for record in played.records)
    assert service.driver.tally.arrivals == 2 and len(service.latencies) > 20
    assert recorder.messages > 500 and not recorder.failed


@pytest.mark.parametrize("moment", [6, 7], ids="moment{}".format)
def test_who_has_arrived_may_doubt_it_later(moment: int) -> None:
    """At least one of the two moments is within a control step."""
    with stage(Rehearsal(1, **FAST)) as played:  # type: ignore[arg-type]
        link, body = played.link, played.stand_in.body
        pose = link.publisher(Topics().topic("own_pose"), urgent=True)
        command = link.publisher(Topics().topic("command", names.TWIST), urgent=True)
        link.subscribe(Topics().topic("scan"))
        heard = 0
        while not played.stop.is_set() and heard < 100:
            try:
                arrival = link.inbox.get(timeout=0.2)
            except Empty:
                continue
            heard += 1
            stamp = link.store.decode(arrival.topic.type, arrival.data).stamp  # type: ignore[union-attr]
            told = body.pose_true.copy()
            if heard == 4:  # carried to the goal's rim; the world waits for this answer
                body.world.pose_true[:2] = body.goal + np.array([0.6, 0.0])
            if heard == moment:
                told[:2] = body.goal + np.array([0.4, 0.0])
            command.put(Velocity(0.0, 0.3 if heard < 4 else 0.0, stamp))
            pose.put(StampedPose(stamp, "map", told))
        played.thread.join(10.0)
    assert [record.outcome for record in played.records] == ["arrived"] and heard < 12


def test_a_clock_that_is_heard_of_late_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lndrl.robot.driving.assembly.is_simulated", lambda link, options: False)
    with stage(Rehearsal(1, **FAST)) as played:  # type: ignore[arg-type]
        service = service_on(played)
        before = service.wanted
        service.run(played.stop, over=within(100.0))
        played.thread.join(10.0)
    assert service.wanted.simulated and not before.simulated
    assert [record.outcome for record in played.records] == ["arrived"]


def test_the_shipped_policy_is_rehearsed() -> None:
    rehearsal = Rehearsal(1, **FAST)  # type: ignore[arg-type]
    with stage(rehearsal, "bridge", "shipped") as played:
        service = service_on(played, planner="shipped")
        service.run(played.stop, over=within(100.0))
        played.thread.join(10.0)
    assert [record.outcome for record in played.records] == ["arrived"]


def test_a_drive_that_ends_leaves_a_stop() -> None:
    rehearsal = Rehearsal(goals=False, **FAST)  # type: ignore[arg-type]
    with stage(rehearsal) as played:
        begun = within(60.0)
        while not played.stand_in.body.goal.any() and not begun():
            time.sleep(0.01)  # the stand-in's thread has no episode yet
        x, y = played.stand_in.body.goal.tolist()
        service = service_on(played, DriveOptions(goal=(x, y)))
        with open_link(Address(_endpoint(played), "rmw", "jazzy"), "witness") as witness:
            witness.subscribe(Topic("/cmd_vel", names.TWIST))
            drove = within(60.0)
            service.run(played.stop, over=lambda: service.driver.tally.decisions > 3 or drove())
            commands = _heard(witness)
    assert any(command.v != 0.0 or command.w != 0.0 for command in commands)
    assert commands[-5:] == [Velocity(0.0, 0.0)] * 5


def _endpoint(played: Stage) -> str:
    links = played.robot._session.zenoh.info.links()
    return f"tcp/{next(str(each.src) for each in links).removeprefix('tcp/')}"


def _heard(link: Link) -> list[Any]:
    found: list[Any] = []
    while True:
        try:
            arrival = link.inbox.get(timeout=1.0)
        except Empty:
            return found
        found.append(link.store.decode(arrival.topic.type, arrival.data))


def test_a_cut_link_and_a_stopped_clock_are_named() -> None:
    rehearsal = Rehearsal(**FAST)  # type: ignore[arg-type]
    with stage(rehearsal) as played:
        service = service_on(played)
        seen: list[set[str]] = []
        views = lambda view: seen.append({stop.reason.label for stop in view.stops})  # noqa: E731
        drove = within(60.0)
        service.run(threading.Event(),
                    views, lambda: service.driver.tally.decisions > 3 or drove())  # fmt: skip
        played.end()
        played.robot.close()
        service.driver.outside.clear()
        cut = within(20.0)
        service.run(threading.Event(), views, lambda: cut() or "link_lost" in seen[-1])
    assert "link_lost" in seen[-1]


@pytest.mark.parametrize("dialect", ["rmw", "bridge"])
def test_a_topic_of_another_type_is_named(dialect: str) -> None:
    endpoint = free_endpoint()
    with open_link(Address(endpoint, dialect, listen=True), "robot") as robot:
        robot.publisher(Topic("/scan", names.POSE))
        robot.subscribe(Topic("/cmd_vel", names.POSE))
        with open_link(Address(endpoint), "drive") as link:
            options = DriveOptions()
            pilot = Pilot(planner_source("straight"), drive_config(config_of(), options))
            service = make_service(link, pilot, options)
            service.run(threading.Event(), over=within(0.3))
            words = {stop.reason.label: stop.words for stop in service.driver.stops}
    assert words["wrong_type"] == (
        "/scan carries geometry_msgs/msg/PoseStamped, not sensor_msgs/msg/LaserScan"
    )


@pytest.mark.parametrize(
    ("name", "published", "wanted"),
    [("/joy", names.JOYSTICK, names.SWITCH), ("/people", names.PEOPLE, names.POSES)],
)
def test_so_is_one_that_would_only_be_missed(name: str, published: str, wanted: str) -> None:
    """A deadman, and people who are tracked in another way: without a word nobody would know."""
    endpoint = free_endpoint()
    with open_link(Address(endpoint, "rmw", listen=True), "robot") as robot:
        robot.publisher(Topic(name, published))
        with open_link(Address(endpoint), "drive") as link:
            options = DriveOptions(enable_topic="/joy")
            pilot = Pilot(planner_source("straight"), drive_config(config_of(), options))
            service = make_service(link, pilot, options)
            service.run(threading.Event(), over=within(0.3))
            words = {stop.reason.label: stop.words for stop in service.driver.stops}
    assert words["wrong_type"] == f"{name} carries {published}, not {wanted}"


def test_a_robot_of_another_distribution_is_named() -> None:
    rehearsal = Rehearsal(**FAST)  # type: ignore[arg-type]
    with (
        stage(rehearsal) as played,
        open_link(Address(_listening(played), "rmw", "humble"), "drive") as link,
    ):
        options = DriveOptions(sim_time="off")
        pilot = Pilot(planner_source("straight"), drive_config(config_of(), options))
        service = make_service(link, pilot, options)
        late = within(20.0)
        service.run(
            threading.Event(),
            over=lambda: late() or "wrong_distribution" in _labels(service),
        )
        assert "wrong_distribution" in {each for each in service.driver.tally.stops} | set(
            _labels(service)
        )


def _labels(service: DriveService) -> list[str]:
    return [stop.reason.label for stop in service.driver.stops]


def _listening(played: Stage) -> str:
    return _endpoint(played)


def test_sensors_under_bad_conditions_still_arrive() -> None:
    conditions = Conditions(delay=0.1, jitter=0.02, loss=0.02)
    rehearsal = Rehearsal(1, conditions=conditions, **FAST)  # type: ignore[arg-type]
    with stage(rehearsal) as played:
        service = service_on(played)
        service.run(played.stop, over=within(100.0))
        played.thread.join(10.0)
    assert [record.outcome for record in played.records] == ["arrived"]


def test_a_policy_of_a_run_folder_is_driven_under_its_own_settings() -> None:
    source = planner_source("shipped")
    config = drive_config(settings_for(source), DriveOptions())
    assert config.localization.delay == 0 and config.localization.update_ticks is None
    assert config.task == settings_for(source).task


def test_topics_by_other_names() -> None:
    topics = Topics().within("/robot1/").renamed({"scan": "/lidar"})
    assert (topics.scan, topics.command, topics.tf) == ("/lidar", "/robot1/cmd_vel", "/tf")
    assert topics.topic("command", names.TWIST_STAMPED).type == names.TWIST_STAMPED
    assert np.unique([topics.topic(p).name for p in vars(topics)]).size == len(vars(topics))
