"""The sender of floods, and who watches it, against a door in this process."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from itertools import pairwise, repeat
from pathlib import Path
from typing import Any, cast

import pytest

from lndrl.chaos import flood, fuzz
from lndrl.chaos.flood import Sent, run_floods
from lndrl.chaos.monitor import Monitor
from lndrl.chaos.stage import Child, Stage
from lndrl.chaos.turns import FLOOD
from lndrl.config import TransportConfig, load_config
from lndrl.transport import Ack, ChunkHeader, Hello, Welcome, free_endpoint, open_learner

ROOT = Path(__file__).resolve().parents[2]
CONFIG = load_config(ROOT / "configs/lndrl.yaml", ["scenario=sparse", "actor.horizon=4"])


class Door:
    """Handlers that take everything that can be read at all, which is wrong."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def on_hello(self, hello: Hello) -> Welcome:
        return Welcome("run", CONFIG.model_dump(mode="json"), 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, Any], size: int) -> Ack:
        self.asked.append(time.monotonic())
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        self.asked.append(time.monotonic())

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        pass


@pytest.fixture
def door() -> Iterator[tuple[str, Door]]:
    endpoint, handlers = free_endpoint(), Door()
    learner = open_learner(TransportConfig(endpoint=endpoint))
    try:
        learner.start(handlers)
        learner.publish_weights(1, b"weights")
        yield endpoint, handlers
    finally:
        learner.close()


def test_floods_come_in_turns(door, monkeypatch: pytest.MonkeyPatch) -> None:
    endpoint, handlers = door
    monkeypatch.setattr(flood, "durations", lambda *_: repeat((0.5, 0.5)))
    told: list[Sent] = []
    run_floods(endpoint, 1, 150, 120.0, threading.Event(), told.append)
    assert told[0] == Sent(), "the first calm begins before anything is sent"
    last = told[-1]
    assert last.count == 150 == sum(last.kinds.values())
    assert sum(one.messages for one in last.floods) == 150
    assert len(last.floods) >= 3, "120 per second, and half a second each"
    assert all(one.begin < one.end for one in last.floods)
    for one, other in zip(last.floods, last.floods[1:], strict=False):
        assert other.begin - one.end >= 0.45
    for moment in handlers.asked:
        assert any(one.begin <= moment for one in last.floods)
    assert last.answers["refused"] > 10
    assert last.taken, "a door that takes a message of another run is found out"


def test_a_flood_ends_when_told(door, monkeypatch: pytest.MonkeyPatch) -> None:
    stop = threading.Event()

    def tell(sent: Sent) -> None:
        if sent.floods:
            stop.set()

    monkeypatch.setattr(flood, "durations", lambda *_: repeat((0.1, 0.5)))
    run_floods(door[0], 1, 10**6, 50.0, stop, tell)
    assert stop.is_set()


class Trains:
    """A monitor of a learner that updates at every look."""

    trained = 0

    def look(self) -> None:
        self.trained += 10

    def rate(self, begin: float, end: float) -> float:
        return 0.0


class Place:
    """A stage whose learner is this process."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        self.endpoint, self.folder, self.learner = endpoint, folder, self
        self.pid = os.getpid()
        self.children: list[Child] = []

    def alive(self) -> bool:
        return True

    def add(self, name: str, command: list[str]) -> Child:
        child = Child(name, command, self.folder)
        child.start()
        self.children.append(child)
        return child

    def watch(self, stop: threading.Event) -> fuzz._Watch:
        monitor = cast(Monitor, Trains())
        return fuzz._Watch(cast(Stage, self), monitor, stop, lambda line: None)


def test_who_watches_hears_all_and_reads_the_cost(
    door, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "CALM", (2.0, 2.5))  # SETTLING, and as long again to read from
    place = Place(door[0], tmp_path)
    stop = threading.Event()
    watch = place.watch(stop)
    try:
        watch.run(200, 1, 80.0)
        (sender,) = place.children
        assert not sender.alive(), sender.tail()
    finally:
        for child in place.children:
            child.kill()
    floods = watch.sent.floods
    assert watch.sent.count == 200 == sum(one.messages for one in floods)
    # One flood is enough where nothing else is at work; on a busy machine another comes, but only
    # after one that had its whole time.
    assert all(one.end - one.begin >= FLOOD[0] for one in floods[:-1])
    assert all(one.messages for one in floods)
    moments = [watch.begin, *(m for one in floods for m in (one.begin, one.end)), watch.end]
    assert len(moments) > 2 and all(a < b for a, b in pairwise(moments))
    found = watch.cost()
    assert found.calm is not None and found.flood is not None
    assert found.ratio is not None and found.ms_per_message is not None


def test_a_sender_without_a_learner_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "CONNECT_WITHIN", 0.5)
    place = Place(free_endpoint(), tmp_path)
    watch = place.watch(threading.Event())
    with pytest.raises(RuntimeError, match="nothing could be sent: no learner answers"):
        watch.run(10, 1, 10.0)
