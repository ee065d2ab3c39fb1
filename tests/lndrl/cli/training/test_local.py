"""How the running training keeps its balance; learner and fleet are stand-ins."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from actors.balance import Balance
from actors.fleet import Fleet
from learner.learner import Learner
from lndrl.cli.training.local import _Evaluator, _keep_balance, reachable
from lndrl.config import load_config
from lndrl.transport import Security
from tests.lndrl.transport.security.authority import make_certificates


class Counted:
    """A fleet that only counts its actors."""

    def __init__(self, actors: int) -> None:
        self.actors = actors

    def __len__(self) -> int:
        return self.actors

    def settled(self) -> bool:
        return True

    def grow(self) -> str:
        self.actors += 1
        return f"actor-{self.actors - 1}"

    def shrink(self) -> str:
        self.actors -= 1
        return f"actor-{self.actors}"


@pytest.fixture
def turn(monkeypatch: pytest.MonkeyPatch):
    """Runs the loop's step for ten minutes; returns fleet, events and actors retired."""

    def run(actors: int, waits: float, idle: float, updates: bool = True) -> Any:
        fleet, balance = Counted(actors), Balance(most=3)
        events: list[tuple[str, str]] = []
        retired: list[str] = []
        learner = SimpleNamespace(
            figures={"kl": 0.1} if updates else {},
            split=SimpleNamespace(shares=lambda window: {"wait": waits}),
            whole=SimpleNamespace(actor_shares=lambda window: {"wait": idle}),
            roster=SimpleNamespace(retire=retired.append),
            events=SimpleNamespace(add=lambda kind, text: events.append((kind, text))),
        )
        now = 50.0
        monkeypatch.setattr("lndrl.cli.training.local.time.monotonic", lambda: now)
        for _ in range(2400):
            now += 0.25
            _keep_balance(balance, cast(Fleet, fleet), cast(Learner, learner))
        return len(fleet), events, retired

    return run


def test_a_waiting_learner_gets_actors_up_to_the_cores(turn) -> None:
    actors, events, retired = turn(1, 0.4, 0.05)
    assert (actors, retired) == (3, [])
    assert [kind for kind, _ in events] == ["balance", "balance"]
    assert "one actor more, 2 now: the learner waited 40% of the last 30 s" in events[0][1]
    assert "the actors 5%" in events[0][1]


def test_idle_actors_leave_and_are_not_missed(turn) -> None:
    actors, events, retired = turn(3, 0.0, 0.9)
    assert (actors, retired) == (1, ["actor-2", "actor-1"])
    assert "one actor less, 1 now" in events[-1][1]


def test_before_the_first_update_nothing_is_known(turn) -> None:
    assert turn(1, 0.9, 0.0, updates=False) == (1, [], [])


def test_without_a_certificate_for_it_nothing_is_validated_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of before there were evaluators has none; training goes on."""
    certificates = make_certificates(tmp_path / "certs")
    (certificates / "evaluator.pem").unlink()
    events: list[tuple[str, str]] = []
    learner = SimpleNamespace(
        events=SimpleNamespace(add=lambda kind, text: events.append((kind, text)))
    )
    config = load_config("lndrl", ["transport.endpoint=tls/localhost:1"])
    evaluator = _Evaluator(config, cast(Learner, learner), Security("learner", certificates))
    evaluator.poll(cast(Fleet, Counted(1)))
    evaluator.stop()
    ((kind, text),) = events
    assert kind == "fleet" and text.startswith("nothing is validated: ")
    assert text.endswith("evaluator.pem: no such file")


def test_an_evaluator_comes_after_the_actors_and_leaves_for_good_with_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started: list[str] = []

    class Fails(Counted):
        error = "the learner refused: no"

        def __init__(self, *_: object, role: str, **__: object) -> None:
            super().__init__(1)
            assert role == "evaluator"

        def start(self) -> None:
            started.append("start")

        def poll(self) -> int:
            return 2

        def stop(self) -> None:
            started.append("stop")

    monkeypatch.setattr("actors.fleet.Fleet", Fails)
    events: list[tuple[str, str]] = []
    learner = SimpleNamespace(
        events=SimpleNamespace(add=lambda kind, text: events.append((kind, text)))
    )
    evaluator = _Evaluator(load_config("lndrl"), cast(Learner, learner), None)
    joined: list[bool] = []
    actors = SimpleNamespace(settled=lambda: bool(joined))
    evaluator.poll(cast(Fleet, actors))
    assert started == []
    joined.append(True)
    for _ in range(3):
        evaluator.poll(cast(Fleet, actors))
    assert started == ["start", "stop"]
    assert events == [("fleet", "nothing is validated: the learner refused: no")]
    off = load_config("lndrl", ["learner.validation_episodes=0"])
    _Evaluator(off, cast(Learner, learner), None).poll(cast(Fleet, actors))
    assert started == ["start", "stop"]


@pytest.mark.parametrize(
    ("endpoint", "here"),
    [
        ("tcp/0.0.0.0:7447", "tcp/127.0.0.1:7447"),
        ("tls/0.0.0.0:7447", "tls/127.0.0.1:7447"),
        ("tcp/[::]:7447", "tcp/[::1]:7447"),
        ("tls/[::]:7447", "tls/localhost:7447"),
        ("tls/learner.example:7447", "tls/learner.example:7447"),
    ],
)
def test_local_actors_go_where_this_machine_reaches_the_learner(endpoint: str, here: str) -> None:
    assert reachable(endpoint) == here
