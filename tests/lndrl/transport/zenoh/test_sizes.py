"""No message vanishes because of a size that one side alone knows, whatever carries it."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    Ack,
    ChunkHeader,
    Hello,
    Security,
    TooLargeError,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
)
from lndrl.transport.keys import UPLOAD
from lndrl.transport.zenoh import actor as actor_room
from lndrl.transport.zenoh.session import ZenohSession, first_answer, open_connecting

HELLO = Hello("actor-0", "first", "here", 1, 1, "0")
MEBIBYTE = 2**20
PATIENCE = 60.0  # s, for machines with much else to do


class Taking:
    """Handlers that welcome and take everything."""

    def __init__(self) -> None:
        self.sizes: list[int] = []

    def on_hello(self, hello: Hello) -> Welcome:
        return Welcome("run", {}, 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, Any], size: int) -> Ack:
        self.sizes.append(size)
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        self.sizes.append(-1)

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None: ...


Opened = Callable[[Any], Any]


@pytest.fixture
def opened() -> Iterator[Opened]:
    """Has what it is given closed when the test is over, the newest first."""
    with ExitStack() as stack:
        yield lambda endpoint: stack.enter_context(closing(endpoint))


def settings(**changes: Any) -> TransportConfig:
    values = {"endpoint": free_endpoint(), "upload_timeout": 20.0, "lease": 10.0, **changes}
    return TransportConfig(**values)


def send(actor: Any, sequence: int, size: int) -> None:
    header = ChunkHeader("run", "actor-0", "first", sequence, 1, 1)
    actor.upload(header, {"x": np.zeros(size, np.uint8)})


def test_a_limit_holds_for_what_lies_in_shared_memory(opened: Opened) -> None:
    """A neighbour on this host could hand over any size, and change it after it was checked."""
    from zenoh.shm import ShmProvider

    config = settings(max_message_megabytes=1)
    handlers = Taking()
    learner = opened(open_learner(config))
    learner.start(handlers)
    rogue = zenoh.Config()
    rogue.insert_json5("mode", '"client"')
    rogue.insert_json5("connect/endpoints", f'["{config.endpoint}"]')
    rogue.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(rogue) as session:
        provider = ShmProvider.default_backend(16 * MEBIBYTE)
        mine = opened(ZenohSession(session))

        def answer(size: int, seconds: float) -> Any:
            buffer = provider.alloc(size)
            buffer[:] = bytes(size)
            return mine.zenoh.get(
                f"{UPLOAD}/x/y/{size}",
                zenoh.handlers.FifoChannel(4),
                payload=zenoh.ZBytes(buffer),
                timeout=seconds,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )

        assert first_answer(answer(1000, PATIENCE)) is not None  # refused as no message of ours
        assert handlers.sizes == [-1]
        assert first_answer(answer(4 * MEBIBYTE, 2.0)) is None
        assert handlers.sizes == [-1]


def test_an_actor_learns_the_learners_limit_and_window(opened: Opened) -> None:
    config = settings(max_message_megabytes=1, upload_window=3)
    handlers = Taking()
    learner = opened(open_learner(config))
    learner.start(handlers)
    actor = opened(open_actor(config.endpoint))  # with the defaults, as on another machine
    actor.hello(HELLO, PATIENCE)
    actor.adopt(config)
    assert actor.ledger.window == len(actor._carriers) == 3
    with pytest.raises(TooLargeError, match="exceeds the 1 of the learner's") as e:
        send(actor, 1, MEBIBYTE)
    assert isinstance(e.value, UserError)
    assert actor.pending() == 0
    send(actor, 1, 1000)
    assert actor.flush(PATIENCE)
    assert len(handlers.sizes) == 1


def test_an_actor_receives_what_its_learner_may_send(opened: Opened) -> None:
    """A session opened with 1 MiB would never see the weights, without a word."""
    config = settings(max_message_megabytes=4)
    learner = opened(open_learner(config))
    learner.start(Taking())
    learner.publish_weights(1, bytes(3 * MEBIBYTE))
    narrow = config.model_copy(update={"max_message_megabytes": 1})
    actor = opened(open_actor(config.endpoint, narrow))
    actor.hello(HELLO, PATIENCE)
    actor.adopt(config)
    version, blob = actor.fetch(timeout=PATIENCE)
    assert (version, len(blob)) == (1, 3 * MEBIBYTE)
    send(actor, 1, 2 * MEBIBYTE)
    assert actor.flush(PATIENCE)


def test_weights_that_an_operators_file_keeps_out_are_said(opened: Opened, tmp_path: Path) -> None:
    overlay = tmp_path / "narrow.json5"
    overlay.write_text("{transport: {link: {rx: {max_message_size: 100000}}}}")
    config = settings()
    learner = opened(open_learner(config))
    learner.start(Taking())
    learner.publish_weights(1, bytes(MEBIBYTE))
    actor = opened(open_actor(config.endpoint, config, Security("actor", overlay=overlay)))
    actor.hello(HELLO, PATIENCE)
    began = time.monotonic()
    with pytest.raises(TooLargeError, match=r"weights of 1 MiB .*/max_message_size \(100000 bytes"):
        actor.fetch(timeout=2 * PATIENCE)
    assert time.monotonic() - began < PATIENCE, "at the first failure, not after all the time"
    narrow = opened(open_learner(settings(), security=Security("learner", overlay=overlay)))
    assert narrow.largest_message == 100_000
    assert learner.largest_message == 256 * MEBIBYTE


def test_an_upload_that_something_on_the_way_drops_is_said(
    opened: Opened, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A router between them may let in less than either side."""
    monkeypatch.setattr(actor_room, "REST", 0.01)
    caplog.set_level(logging.WARNING)
    config = settings(max_message_megabytes=1, upload_timeout=0.3)
    learner = opened(open_learner(config))
    learner.start(Taking())
    wide = config.model_copy(update={"max_message_megabytes": 8})
    actor = opened(open_actor(config.endpoint, wide))
    actor.hello(HELLO, PATIENCE)
    send(actor, 1, 2 * MEBIBYTE)
    said = "an upload of 2 MiB has had no answer 3 times"
    deadline = time.monotonic() + PATIENCE
    while said not in caplog.text and time.monotonic() < deadline:
        assert not actor.flush(0.1)
    assert said in caplog.text


def test_sessions_of_every_side_take_nothing_from_shared_memory(
    opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[zenoh.Config] = []
    real = zenoh.open

    def note(config: zenoh.Config) -> zenoh.Session:
        built.append(config)
        return real(config)

    config = settings()
    monkeypatch.setattr(zenoh, "open", note)
    opened(open_learner(config)).start(Taking())
    assert opened(open_connecting(config.endpoint, config, PATIENCE)).connected()
    assert len(built) == 2
    for each in built:
        assert '"enabled":false,"mode"' in each.get_json("transport/shared_memory")
