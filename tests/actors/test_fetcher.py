"""Weights that come while the worlds go on."""

from __future__ import annotations

import threading
import time
from typing import cast

import pytest

from actors.actor import Actor
from actors.fetcher import Fetcher
from lndrl.transport import ActorEndpoint, MemoryNetwork, MessageError

PATIENCE = 60.0  # s, for machines with much else to do


class SlowEndpoint:
    """Answers a fetch when told to."""

    def __init__(self) -> None:
        self.open = threading.Event()
        self.answer: tuple[int, bytes] | Exception = (3, b"weights")
        self.fetches = 0

    def fetch(self, version, timeout):
        self.fetches += 1
        assert self.open.wait(PATIENCE)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def fetcher(self) -> Fetcher:
        return Fetcher(cast(ActorEndpoint, self))


def wait_for(fetcher: Fetcher, learner: str):
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        taken = fetcher.take(learner)
        if taken is not None:
            return taken
        time.sleep(0.01)
    return None


def ended(fetcher: Fetcher) -> None:
    assert fetcher._thread is not None
    fetcher._thread.join(PATIENCE)
    assert not fetcher._thread.is_alive()


def test_one_fetch_at_a_time_that_nobody_waits_for():
    endpoint = SlowEndpoint()
    fetcher = endpoint.fetcher()
    assert fetcher.take("a") is None
    fetcher.begin("a")
    fetcher.begin("a")
    assert fetcher.take("a") is None
    endpoint.open.set()
    assert wait_for(fetcher, "a") == (3, b"weights")
    assert endpoint.fetches == 1
    assert fetcher.take("a") is None
    fetcher.begin("a")
    assert wait_for(fetcher, "a") == (3, b"weights")


def test_weights_of_a_learner_that_is_gone_are_dropped():
    endpoint = SlowEndpoint()
    endpoint.open.set()
    fetcher = endpoint.fetcher()
    fetcher.begin("old")
    ended(fetcher)
    assert fetcher.take("new") is None
    fetcher.begin("new")
    assert wait_for(fetcher, "new") == (3, b"weights")


def test_a_timeout_is_nothing_and_damage_is_told():
    endpoint = SlowEndpoint()
    endpoint.open.set()
    fetcher = endpoint.fetcher()
    endpoint.answer = TimeoutError("late")
    fetcher.begin("a")
    ended(fetcher)
    assert fetcher.take("a") is None
    endpoint.answer = MessageError("damaged")
    fetcher.begin("a")
    ended(fetcher)
    with pytest.raises(MessageError, match="damaged"):
        fetcher.take("a")


def test_an_actor_goes_on_with_its_weights_until_newer_ones_are_here(small_config, noting_learner):
    network = MemoryNetwork()
    learner = noting_learner(small_config(), network.learner())
    learner.publish(0)
    actor = Actor(network.actor(), alone=True)
    assert actor.run_chunk()
    learner.publish(1)
    actor.endpoint.flush(PATIENCE)
    assert actor.run_chunk(), "asks for version 1 and does not wait for it"
    assert actor._fetcher is not None
    ended(actor._fetcher)
    actor.endpoint.flush(PATIENCE)
    assert actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [0, 0, 1]
