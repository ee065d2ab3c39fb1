"""A site's door: uploads and members go through, weights come once, and it outlives a learner."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    Ack,
    ChunkHeader,
    Hello,
    LearnerUnreachableError,
    Refusal,
    Security,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
    open_site,
    open_viewer,
)
from lndrl.transport.frames import encode_frame
from tests.lndrl.transport.security.authority import make_certificates
from tests.lndrl.transport.test_frames import arrays, frame

PATIENCE = 60.0
BLOB = np.random.default_rng(0).bytes(3_000_000)


class Handlers:
    def __init__(self) -> None:
        self.sequences: list[tuple[str, int]] = []
        self.alive: set[str] = set()

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return Welcome("run", {}, 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        self.sequences.append((header.actor_id, header.sequence))
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        raise AssertionError(reason)

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        (self.alive.add if alive else self.alive.discard)(actor_id)


class Place:
    """A learner, a site's door and what protects them; all closed in the end."""

    def __init__(self, folder: Path | None) -> None:
        scheme = "tcp" if folder is None else "tls"
        self.stack = ExitStack()
        self.folder = folder
        config = TransportConfig(endpoint=free_endpoint(), lease=5.0, upload_timeout=20.0)
        self.near, self.far = (
            config.model_copy(update={"endpoint": scheme + free_endpoint().removeprefix("tcp")})
            for _ in range(2)
        )
        self.handlers = Handlers()

    def security(self, role: str) -> Security | None:
        return None if self.folder is None else Security(role, self.folder)

    def learner(self) -> Any:
        found = open_learner(self.far, "run", self.security("learner"))
        self.stack.callback(found.close)
        found.start(self.handlers)
        return found

    def site(self) -> Any:
        role = self.security("site")
        return self.stack.enter_context(
            closing(open_site(self.far.endpoint, self.near, role, role))
        )

    def actor(self, name: str) -> Any:
        found = open_actor(self.near.endpoint, self.near, self.security("actor"))
        self.stack.callback(found.close)
        found.hello(Hello(name, "first", "here", 1, 8, "0.1"), PATIENCE)
        return found


@pytest.fixture(params=["plain", "tls"])
def place(request, tmp_path: Path) -> Iterator[Place]:
    folder = None
    if request.param == "tls":
        folder = tmp_path / "certs"
        make_certificates(folder)
    made = Place(folder)
    with made.stack:
        yield made


def send(actor: Any, name: str, sequence: int) -> None:
    header = ChunkHeader("run", name, "first", sequence, 1, 1)
    actor.upload(header, {"x": np.zeros(100_000, np.uint8)}, PATIENCE)


def wait_until(condition: Callable[[], object]) -> bool:
    deadline = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return bool(condition())


def test_uploads_and_members_go_through_and_weights_come_once(place: Place) -> None:
    learner = place.learner()
    learner.publish_weights(1, BLOB)
    site = place.site()
    names = ["actor-0", "actor-1", "actor-2"]
    actors = [place.actor(name) for name in names]
    for actor, name in zip(actors, names, strict=True):
        for sequence in (1, 2, 3):
            send(actor, name, sequence)
    assert all(actor.flush(PATIENCE) for actor in actors)
    assert sorted(place.handlers.sequences) == [(name, n) for name in names for n in (1, 2, 3)]
    assert wait_until(lambda: place.handlers.alive == set(names)) and site.members() == 3
    assert [actor.fetch(None, PATIENCE) for actor in actors] == [(1, BLOB)] * 3
    learner.publish_weights(2, BLOB[::-1])
    assert all(actor.wait_newer(1, PATIENCE) for actor in actors)
    assert [actor.fetch(None, PATIENCE) for actor in actors] == [(2, BLOB[::-1])] * 3
    assert site.cache.fetched == 2 and site.cache.served >= 6
    actors[0].close()
    assert wait_until(lambda: place.handlers.alive == set(names[1:]))
    learner.finish()
    assert wait_until(actors[1].done) and wait_until(site.done.is_set)


def test_it_outlives_a_learner(place: Place) -> None:
    learner = place.learner()
    learner.publish_weights(1, BLOB)
    place.site()
    actor = place.actor("actor-0")
    assert actor.fetch(None, PATIENCE) == (1, BLOB)
    learner.close()
    again = place.learner()
    again.publish_weights(1, BLOB[:1000])
    assert wait_until(actor.needs_hello)
    actor.hello(Hello("actor-0", "first", "here", 1, 8, "0.1"), PATIENCE)
    send(actor, "actor-0", 1)
    assert actor.flush(PATIENCE) and place.handlers.sequences == [("actor-0", 1)]
    assert wait_until(lambda: actor.fetch(None, PATIENCE) == (1, BLOB[:1000]))


def test_where_no_learner_is_a_sentence_says_so_and_the_port_is_free_again(place: Place) -> None:
    with pytest.raises(LearnerUnreachableError, match="no learner answers at"):
        place.site()
    place.learner()
    place.site()
    with pytest.raises(UserError, match="in use"):
        place.site()


def test_a_world_is_seen_through_it_while_somebody_watches(place: Place) -> None:
    place.learner()
    place.site()
    actor = place.actor("actor-0")
    viewer = open_viewer(place.far.endpoint, place.far, place.security("dashboard"))
    place.stack.callback(viewer.close)
    assert not actor.watched()
    seat = viewer.watch("actor-0")
    assert wait_until(actor.watched)

    found: list[Any] = []

    def seen() -> bool:
        actor.show(encode_frame(frame(), arrays()))
        found.append(seat.newest())
        return any(each is not None for each in found)

    assert wait_until(seen)
    seat.close()
    assert wait_until(lambda: not actor.watched())
