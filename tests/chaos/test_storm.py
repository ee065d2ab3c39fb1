"""Hundreds of actors that join at once are all welcomed and their chunks taken once."""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from lndrl.chaos import storm as storm_room
from lndrl.chaos.ledger import ActorBook, lines_of
from lndrl.chaos.storm import storm
from lndrl.config import TransportConfig, load_config
from lndrl.transport import Ack, ChunkHeader, Hello, Welcome, free_endpoint, open_learner

ACTORS = 300
ROOT = Path(__file__).resolve().parents[2]


class Door:
    """Handlers that welcome everybody and pause every third chunk once."""

    def __init__(self) -> None:
        config = load_config(ROOT / "configs/lndrl.yaml", ["actor.horizon=8"])
        self.config = config.model_dump(mode="json")
        self.taken: Counter[tuple[str, str, int]] = Counter()
        self.members: set[str] = set()
        self.malformed: list[str] = []
        self._paused: set[str] = set()
        self._lock = threading.Lock()

    def on_hello(self, hello: Hello) -> Welcome:
        return Welcome("run", self.config, int(hello.actor_id[-3:]))

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, Any], size: int) -> Ack:
        with self._lock:
            if header.actor_id.endswith("3") and header.actor_id not in self._paused:
                self._paused.add(header.actor_id)
                return Ack("pause")
            assert arrays["action"].size == 8
            self.taken[header.actor_id, header.incarnation, header.sequence] += 1
            return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        self.malformed.append(reason)

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        with self._lock:
            (self.members.add if alive else self.members.discard)(actor_id)


def test_300_actors_join_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # On a slow machine nothing is sent again only because the answer takes its time.
    monkeypatch.setattr(storm_room, "ANSWER_SECONDS", 300.0)
    monkeypatch.setattr(storm_room, "CONNECT_SECONDS", 300.0)
    config = TransportConfig(endpoint=free_endpoint())
    learner = open_learner(config)
    door = Door()
    try:
        learner.start(door)
        learner.publish_weights(1, b"weights")
        report = storm(config.endpoint, ACTORS, 300.0, tmp_path / "book.jsonl")
    finally:
        learner.close()
    assert (report.connected, report.welcomed, report.accepted) == (ACTORS, ACTORS, ACTORS)
    assert report.refused == report.unanswered == 0
    assert door.malformed == []
    assert len(door.taken) == ACTORS
    assert set(door.taken.values()) == {1}
    book = ActorBook().read(lines_of(tmp_path / "book.jsonl"))
    assert len(book.produced) == ACTORS
    assert set(book.answers.values()) == {"accepted"}
