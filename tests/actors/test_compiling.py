"""An actor that compiles says so to its learner and its fleet, over either transport."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest

from actors import actor as actor_room
from actors.actor import Actor
from lndrl import kernels
from lndrl.config import RunConfig, TransportConfig
from lndrl.transport import (
    Ack,
    ActorEndpoint,
    Hello,
    LearnerEndpoint,
    MemoryNetwork,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
)
from tests.learner.helpers_learner import small_config


class Listening:
    """Welcomes everybody and remembers what was said."""

    def __init__(self, config: RunConfig) -> None:
        self.hellos: list[Hello] = []
        self.config = config.model_dump(mode="json")

    def on_hello(self, hello: Hello) -> Welcome:
        self.hellos.append(hello)
        return Welcome("run", self.config, 0)

    def on_chunk(self, *_: Any) -> Ack:
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None: ...

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None: ...


@pytest.fixture(params=["zenoh", "memory"])
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[LearnerEndpoint, ActorEndpoint]]:
    """A learner's and an actor's endpoint."""
    with ExitStack() as stack:
        if request.param == "memory":
            network = MemoryNetwork()
            both: tuple[LearnerEndpoint, ActorEndpoint] = network.learner(), network.actor()
        else:
            config = TransportConfig(endpoint=free_endpoint())
            both = open_learner(config), open_actor(config.endpoint, config)
        for endpoint in both:
            stack.enter_context(closing(endpoint))
        yield both


def test_learner_and_fleet_hear_how_far_the_kernels_are(
    ends: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    door, endpoint = ends
    config = small_config()
    handlers = Listening(config)
    door.start(handlers)
    monkeypatch.setattr(actor_room, "TELL_EVERY", 0.0)
    told: list[tuple[str, str]] = []

    class Compiling(actor_room.Rollout):
        def __init__(self, *arguments: Any) -> None:
            for ready in (0, 12):  # as numba does, in the middle of building
                kernels.tell(ready, 31)
            super().__init__(*arguments)

    monkeypatch.setattr(actor_room, "Rollout", Compiling)
    actor = Actor(endpoint, alone=True, on_event=lambda event, text: told.append((event, text)))
    actor.join()

    def said() -> list[tuple[int, int]]:
        return [(hello.kernels_ready, hello.kernels_needed) for hello in list(handlers.hellos)]

    # Nobody waits for what is told; where kernels really are missing, more is told than here.
    deadline = time.monotonic() + 60.0
    while not (len(said()) >= 4 and said()[-1] == (0, 0)) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert said()[:3] == [(0, 0), (0, 31), (12, 31)] and said()[-1] == (0, 0) and len(said()) >= 4
    assert len({hello.incarnation for hello in handlers.hellos}) == 1
    assert told[0][0] == "starting" and "compiling kernels, 0 of 31 ready" in told[0][1]
    assert told[-1][0] == "joined"
    assert not endpoint.needs_hello()


def test_who_has_all_kernels_says_hello_once(ends: tuple[Any, Any]) -> None:
    door, endpoint = ends
    config = small_config()
    actor_room.Rollout(config, 0, 1)  # compiled by now, whoever came first
    handlers = Listening(config)
    door.start(handlers)
    Actor(endpoint, alone=True).join()
    assert len(handlers.hellos) == 1
