"""Two sessions over a real Zenoh link on loopback, in both dialects."""

from __future__ import annotations

import json
import signal
import threading
import time
from collections.abc import Callable
from queue import Empty
from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.robot.link import LATCHED, SENSOR, Address, Arrival, Link, Topic, open_link
from lndrl.robot.link.rmw import read_attachment
from lndrl.robot.messages import GridMap, Scan, Velocity, names
from lndrl.transport.zenoh.session import free_endpoint

SCAN = Topic("/scan", names.SCAN, SENSOR)
MAP = Topic("/map", names.MAP, LATCHED)
COMMAND = Topic("/cmd_vel", names.TWIST)


def until(true: Callable[[], Any], seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while not true():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def taken(link: Link, seconds: float = 5.0) -> Arrival:
    arrival: Arrival = link.inbox.get(timeout=seconds)
    return arrival


def scan(stamp: int) -> Scan:
    return Scan(stamp, "laser", -1.0, 0.1, 0.1, 12.0, np.ones(20, np.float32))


def there(link: Link, *topics: str) -> bool:
    return set(topics) <= {each.topic for each in link.endpoints()}


@pytest.mark.parametrize(
    ("dialect", "distribution"), [("rmw", "jazzy"), ("rmw", "humble"), ("bridge", "jazzy")]
)
def test_a_robot_is_found_heard_and_told(dialect: str, distribution: str) -> None:
    endpoint = free_endpoint()
    with open_link(Address(endpoint, dialect, distribution, listen=True), "robot") as robot:
        robot.publisher(MAP).put(GridMap(1, "map", 0.05, np.zeros(3), np.zeros((4, 3), np.int8)))
        scans = robot.publisher(SCAN)
        robot.subscribe(COMMAND)
        with open_link(Address(endpoint), "drive") as drive:
            assert drive.dialect.name == dialect and drive.store.distribution == distribution
            assert there(drive, "/scan", "/map", "/cmd_vel") and drive.connected()
            drive.subscribe(MAP)
            arrival = taken(drive)  # published before anybody listened
            content = drive.store.decode(names.MAP, arrival.data)
            assert isinstance(content, GridMap) and content.cells.shape == (4, 3)
            assert drive.dialect.hash_in(arrival.key) == (
                robot.store.type_hash(names.MAP) if dialect == "rmw" else ""
            )
            drive.subscribe(SCAN)
            commands = drive.publisher(COMMAND, urgent=True)
            assert until(lambda: there(robot, "/scan", "/cmd_vel"))
            for stamp in range(5):
                scans.put(scan(stamp))
            stamps = [drive.store.decode(names.SCAN, taken(drive).data).stamp for _ in range(5)]  # type: ignore[union-attr]
            assert stamps == [0, 1, 2, 3, 4]
            commands.put(Velocity(0.2, -0.1))
            assert robot.store.decode(names.TWIST, taken(robot).data) == Velocity(0.2, -0.1)
        assert until(lambda: not there(robot, "/scan")), "its tokens leave with it"
        assert not drive.connected() and drive.closed


def test_messages_have_the_attachment_that_rmw_zenoh_wants() -> None:
    import zenoh

    endpoint = free_endpoint()
    with open_link(Address(endpoint, "rmw", "jazzy", listen=True), "robot") as robot:
        config = zenoh.Config.from_json5(
            json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]},
                        "scouting": {"multicast": {"enabled": False}}})
        )  # fmt: skip
        with zenoh.open(config) as other:
            subscriber = other.declare_subscriber(robot.dialect.publish_key(SCAN))
            scans = robot.publisher(SCAN)
            time.sleep(0.3)
            for stamp in range(2):
                scans.put(scan(stamp))
            attachments = [subscriber.recv().attachment for _ in range(2)]
            read = [read_attachment(each.to_bytes()) for each in attachments if each is not None]
            assert [each[0] for each in read] == [1, 2], "sequence numbers from 1"
            assert abs(read[0][1] - time.time_ns()) < 10e9
            tokens = other.liveliness().get("@ros2_lv/0/**")
            keys = [str(reply.ok.key_expr) for reply in tokens if reply.ok is not None]
            assert any("/MP/" in key and "%scan" in key for key in keys)
            assert any(key.endswith("/NN/%/%/robot") for key in keys)


def test_a_lost_link_is_seen_and_comes_back() -> None:
    endpoint = free_endpoint()
    robot = open_link(Address(endpoint, "bridge", listen=True), "robot")
    with open_link(Address(endpoint, "bridge", "jazzy"), "drive") as drive:
        assert drive.connected()
        commands = drive.publisher(COMMAND)
        robot.close()
        assert until(lambda: not drive.connected())
        commands.put(Velocity(0.1, 0.0))  # goes nowhere, and says nothing
        with open_link(Address(endpoint, "bridge", listen=True), "robot") as again:
            again.subscribe(COMMAND)
            assert until(drive.connected, 10.0)
            assert until(lambda: _put_until_heard(commands, again))


def test_closing_waits_for_nobody() -> None:
    """Whatever hangs in taking leave, the link is closed within seconds."""
    link = open_link(Address(free_endpoint(), "bridge", listen=True), "robot")
    release = threading.Event()

    class Hangs:
        def undeclare(self) -> None:
            release.wait(30.0)

    link._kept.append(Hangs())
    began = time.monotonic()
    link.close()
    took = time.monotonic() - began
    release.set()
    assert link.closed and took < 10.0


def _put_until_heard(commands: Any, robot: Link) -> bool:
    commands.put(Velocity(0.1, 0.0))
    time.sleep(0.05)
    return not robot.inbox.empty()


def test_nobody_there_is_a_sentence() -> None:
    with pytest.raises(UserError, match=r"no robot answers at tcp/127\.0\.0\.1:\d+ within 0\.3 s"):
        open_link(Address(free_endpoint(), timeout=0.3), "drive")
    with pytest.raises(UserError, match="dialect dds: must be one of rmw, bridge"):
        open_link(Address(free_endpoint(), "dds"), "drive")
    with pytest.raises(UserError, match="open to other machines and not protected"):
        open_link(Address("tcp/0.0.0.0:7447", "rmw", listen=True), "robot")


def test_a_wait_ends_though_a_signal_took_longer_than_it() -> None:
    def slow(*_: object) -> None:
        time.sleep(0.4)

    with open_link(Address(free_endpoint(), "rmw", "jazzy", listen=True), "robot") as robot:
        before = signal.signal(signal.SIGALRM, slow)
        waker = threading.Timer(5.0, robot.inbox.put, ("nobody else ends this wait",))
        waker.start()
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.1)
            with pytest.raises(Empty):
                robot.inbox.get(timeout=0.2)
        finally:
            signal.signal(signal.SIGALRM, before)
            waker.cancel()
