"""The evaluator's endpoint, over Zenoh on loopback and in memory: the same answers."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport import (
    COUNTS,
    NO_WEIGHTS,
    PROTOCOL_VERSION,
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    LearnerUnreachableError,
    MemoryNetwork,
    Refusal,
    ValidationResult,
    ValidationTask,
    WeightsGoneError,
    Welcome,
    free_endpoint,
    open_evaluator,
    open_learner,
)
from lndrl.transport.keys import PING
from lndrl.transport.zenoh.session import open_session
from lndrl.version import VERSION

HELLO = EvaluatorHello("evaluator-0", "first", "here", 1, VERSION)
GOOD = dict(zip(COUNTS, (4, 1, 2, 1, 0, 200), strict=True))
RESULT = ValidationResult("run-1", "evaluator-0", "first", "one", 7, 2.5, GOOD, GOOD)


class Handlers:
    """Hands out version 7 and keeps what it is told."""

    def __init__(self) -> None:
        self.results: list[ValidationResult] = []
        self.refusal = ""

    def on_evaluator(self, hello: EvaluatorHello) -> ValidationTask | Refusal:
        if self.refusal:
            return Refusal(self.refusal)
        return ValidationTask("run-1", {"seed": 3}, 7 if hello.ready else NO_WEIGHTS)

    def on_validation(self, result: ValidationResult) -> Ack:
        self.results.append(result)
        return Ack("accepted")

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return Refusal("no actors here")

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        return Ack("refused")

    def on_malformed(self, reason: str) -> None: ...

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None: ...


class Place:
    """Where learner and evaluator meet; ``kind`` memory or zenoh."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.network = MemoryNetwork()
        self.config = TransportConfig(endpoint=free_endpoint(), lease=2.0)
        self.handlers = Handlers()
        self.open: list[Any] = []

    def learner(self, validates: bool = True) -> Any:
        made = self.network.learner() if self.kind == "memory" else open_learner(self.config)
        self.open.append(made)
        made.start(self.handlers, self.handlers if validates else None)
        return made

    def evaluator(self) -> Any:
        memory = self.kind == "memory"
        made = self.network.evaluator() if memory else open_evaluator(self.config.endpoint)
        self.open.append(made)
        return made


@pytest.fixture(params=["memory", "zenoh"])
def place(request: pytest.FixtureRequest) -> Iterator[Place]:
    made = Place(request.param)
    yield made
    for each in reversed(made.open):
        each.close()


def test_it_asks_fetches_and_reports(place: Place) -> None:
    learner, evaluator = place.learner(), place.evaluator()
    learner.publish_weights(7, b"w" * 100_000)
    task = evaluator.ask(HELLO, 20)
    assert (task.run_id, task.version, task.config) == ("run-1", 7, {"seed": 3})
    assert task.learner_incarnation == learner.incarnation and not task.done
    assert evaluator.fetch(7, 20) == b"w" * 100_000
    ack = evaluator.report(RESULT, 20)
    assert ack.status == "accepted" and place.handlers.results == [RESULT]
    assert evaluator.ask(dataclasses.replace(HELLO, ready=False), 20).version == NO_WEIGHTS
    learner.finish()
    assert evaluator.ask(HELLO, 20).done


def test_it_gets_what_is_tested_where_actors_act_on_other_weights(place: Place) -> None:
    learner, evaluator = place.learner(), place.evaluator()
    learner.publish_weights(7, b"acting", b"tested" * 9)
    assert evaluator.fetch(7, 20) == b"tested" * 9
    learner.publish_weights(8, b"both")
    assert [evaluator.fetch(version, 20) for version in (8, 7)] == [b"both", b"tested" * 9]
    learner.publish_weights(9, b"acting", b"tested")
    learner.publish_weights(9, b"both again")
    assert evaluator.fetch(9, 20) == b"both again"


def test_versions_that_are_gone_are_said_to_be(place: Place) -> None:
    learner, evaluator = place.learner(), place.evaluator()
    for version in (1, 2, 3):
        learner.publish_weights(version, b"w")
    for version in (1, 4):
        with pytest.raises(WeightsGoneError, match=f"version {version} is no longer kept"):
            evaluator.fetch(version, 20)


def test_a_refusal_is_one_sentence(place: Place) -> None:
    place.learner()
    place.handlers.refusal = "this run validates nothing"
    with pytest.raises(UserError, match=r"refused.*: this run validates nothing"):
        place.evaluator().ask(HELLO, 20)


@pytest.mark.parametrize("change", [{"protocol": 99}])
def test_another_protocol_is_refused_before_the_handlers(place: Place, change: dict) -> None:
    place.learner()
    with pytest.raises(UserError, match="speaks protocol 1, this evaluator 99; install the same"):
        place.evaluator().ask(dataclasses.replace(HELLO, **change), 20)


def test_a_learner_without_validation_takes_no_evaluator(place: Place) -> None:
    place.learner(validates=False)
    evaluator = place.evaluator()
    with pytest.raises(UserError, match="this learner takes no evaluator"):
        evaluator.ask(HELLO, 20)
    assert evaluator.report(RESULT, 20).status == "refused"


def test_nobody_there_is_said(place: Place) -> None:
    evaluator = place.evaluator()
    with pytest.raises(LearnerUnreachableError, match="no learner"):
        evaluator.ask(HELLO, 0.5)
    assert evaluator.report(RESULT, 0.2) is None


def test_a_learner_that_is_started_anew_is_found() -> None:
    place = Place("zenoh")
    try:
        first = place.learner()
        evaluator = place.evaluator()
        assert evaluator.ask(HELLO, 20).learner_incarnation == first.incarnation
        first.close()
        assert evaluator.report(RESULT, 0.5) is None
        second = place.learner()
        assert evaluator.ask(HELLO, 60).learner_incarnation == second.incarnation
        assert evaluator.report(RESULT, 60).status == "accepted"
    finally:
        for each in reversed(place.open):
            each.close()


@pytest.fixture
def old_learner() -> Iterator[Callable[..., str]]:
    """Something that answers pings alone; returns where it listens."""
    sessions = []

    def listen(**pong: Any) -> str:
        endpoint = free_endpoint()
        session = open_session(
            {
                "mode": "router",
                "listen/endpoints": [endpoint],
                "scouting/multicast/enabled": False,
                "scouting/gossip/enabled": False,
            },
            30,
        )
        sessions.append(session)
        data = json.dumps(pong).encode()

        def reply(query: zenoh.Query) -> None:
            with query:
                query.reply(PING, data)

        session.declare_queryable(PING, reply)
        return endpoint

    yield listen
    for session in sessions:
        session.close()


def test_a_learner_of_before_there_were_evaluators(old_learner: Callable[..., str]) -> None:
    evaluator = open_evaluator(old_learner(program_version="0.0.1", protocol=1, run_id="x"))
    try:
        with pytest.raises(UserError, match=r"is lndrl 0\.0\.1 .*; install the same") as caught:
            evaluator.ask(HELLO, 4)
        assert not isinstance(caught.value, LearnerUnreachableError)
    finally:
        evaluator.close()


def test_a_learner_that_denies_the_role(old_learner: Callable[..., str]) -> None:
    endpoint = old_learner(program_version=VERSION, protocol=PROTOCOL_VERSION)
    evaluator = open_evaluator(endpoint)
    try:
        with pytest.raises(UserError, match="to an evaluator, though it answers pings"):
            evaluator.ask(HELLO, 4)
    finally:
        evaluator.close()
