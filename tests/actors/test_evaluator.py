"""The evaluator: what it plays, how it rests, and how it outlives learners."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from actors.evaluator import Evaluator
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation.validation import FIRST, ValidationEpisodes
from lndrl.policy import initial_weights
from lndrl.transport import (
    NO_WEIGHTS,
    Ack,
    EvaluatorHello,
    LearnerUnreachableError,
    ValidationResult,
    ValidationTask,
    WeightsGoneError,
)

Small = Callable[..., RunConfig]


class Desk:
    """A learner's answers, one after another, without a network; keeps what it is told."""

    def __init__(self, config: RunConfig, *answers: Any) -> None:
        self.config = config
        self.blob = initial_weights(config)
        self.answers = list(answers)
        self.acks: list[Ack | None] = []
        self.hellos: list[EvaluatorHello] = []
        self.results: list[ValidationResult] = []
        self.gone: set[int] = set()

    def task(self, version: int = NO_WEIGHTS, learner: str = "one", done: bool = False) -> Any:
        config = self.config.model_dump(mode="json")
        return ValidationTask("run-1", config, version, learner, done)

    def ask(self, hello: EvaluatorHello, timeout: float = 10.0) -> ValidationTask:
        self.hellos.append(hello)
        answer = self.answers.pop(0) if self.answers else self.task(done=True)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def fetch(self, version: int, timeout: float = 10.0) -> bytes:
        if version in self.gone:
            raise WeightsGoneError(f"version {version} is no longer kept")
        return self.blob

    def report(self, result: ValidationResult, timeout: float = 10.0) -> Ack | None:
        self.results.append(result)
        return self.acks.pop(0) if self.acks else Ack("accepted")

    def close(self) -> None: ...


@pytest.fixture
def config(small_config: Small, monkeypatch: pytest.MonkeyPatch) -> RunConfig:
    monkeypatch.setattr("actors.evaluator.ASK_EVERY", 0.0)
    monkeypatch.setattr("actors.evaluator.PATIENT_TIMEOUT", 0.0)
    return small_config(learner={"validation_episodes": 3}, task={"time_limit": 4.0})


def test_a_round_counts_the_same_episodes_sampled_and_greedy(config: RunConfig) -> None:
    desk = Desk(config)
    desk.answers = [desk.task(5), desk.task(6, "two")]
    evaluator = Evaluator(desk, evaluator_id="e")
    assert evaluator.round() and evaluator.round()
    first, second = desk.results
    assert (first.version, first.learner_incarnation, first.run_id) == (5, "one", "run-1")
    assert (second.version, second.learner_incarnation) == (6, "two")
    assert first.sampled["episodes"] == first.greedy["episodes"] == 3
    assert (first.sampled, first.greedy) == (second.sampled, second.greedy), "the same weights"


def test_episodes_are_those_of_lndrl_evaluate_but_for_their_numbers(config: RunConfig) -> None:
    from lndrl.evaluation import EpisodeRunner
    from lndrl.planners import PlannerSource

    weights = initial_weights(config)
    counts = ValidationEpisodes(config, 3)(weights)
    seeded = config.model_copy(update={"seed": 0})
    torch.set_num_threads(1)
    runner = EpisodeRunner(PlannerSource("x", seeded, weights), seeded)
    records = list(runner([FIRST, FIRST + 1, FIRST + 2]))
    assert counts is not None
    assert counts["steps"] == sum(record.steps for record in records)
    for outcome in ("arrived", "collided", "lost", "timeout"):
        assert counts[outcome] == sum(record.outcome == outcome for record in records)


def test_other_weights_are_really_played(config: RunConfig) -> None:
    """Two policies that always do the same, each something else, do not walk alike."""
    episodes = ValidationEpisodes(config, 3)
    one = initial_weights(config)
    two = initial_weights(config.model_copy(update={"seed": 77}))
    first = episodes(one, True)
    assert first != episodes(two, True)
    assert first == episodes(one, True)


def test_a_process_that_trains_finds_its_generators_and_threads_as_they_were(
    config: RunConfig,
) -> None:
    threads = torch.get_num_threads()
    torch.manual_seed(3)
    np.random.seed(3)
    expected = torch.rand(2), np.random.rand(2)
    torch.manual_seed(3)
    np.random.seed(3)
    ValidationEpisodes(config, 2)(initial_weights(config.model_copy(update={"seed": 4})))
    torch.manual_seed(3)
    ValidationEpisodes(config, 2)
    assert torch.equal(torch.rand(2), expected[0])
    assert (np.random.rand(2) == expected[1]).all()
    assert torch.get_num_threads() == threads


def test_weights_that_are_gone_are_asked_for_anew(config: RunConfig) -> None:
    desk = Desk(config)
    desk.gone = {5}
    desk.answers = [desk.task(5), desk.task(6)]
    Evaluator(desk).run(threading.Event())
    assert [result.version for result in desk.results] == [6]


def test_it_rests_as_long_as_its_share_asks_and_hears_the_end_meanwhile(
    config: RunConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, worked = [0.0], [0.0]
    monkeypatch.setattr("actors.evaluator.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("actors.evaluator.time.process_time", lambda: worked[0])
    desk = Desk(config)
    desk.answers = [desk.task(number) for number in range(400)]
    ready: list[float] = []

    class Working(Evaluator):
        def _validate(self, task: ValidationTask, stopped: Callable[[], bool]) -> bool:
            ready.append(clock[0])
            clock[0] += 20.0  # the machine is busy: 12 s of work take 20
            worked[0] += 12.0
            return True

    ask = desk.ask

    def resting(hello: EvaluatorHello, timeout: float = 10.0) -> ValidationTask:
        clock[0] += 1.0
        return ask(hello) if hello.ready else dataclasses.replace(ask(hello), version=NO_WEIGHTS)

    monkeypatch.setattr(desk, "ask", resting)
    Working(desk).run(threading.Event())
    pauses = np.diff(ready)
    share = config.learner.validation_share
    assert len(ready) > 3 and (pauses >= 12.0 / share - 1e-6).all()
    assert (pauses <= 12.0 / share + 2.0).all()
    assert not all(hello.ready for hello in desk.hellos)


def test_a_result_is_told_until_a_learner_answers(config: RunConfig) -> None:
    desk = Desk(config)
    desk.answers = [desk.task(5)]
    desk.acks = [None, None, Ack("accepted")]
    heard: list[tuple[str, str]] = []
    Evaluator(desk, on_event=lambda *event: heard.append(event)).run(threading.Event())
    assert len({repr(result) for result in desk.results}) == 1 and len(desk.results) == 3
    assert [event for event, _ in heard] == ["joined", "validated"]


def test_a_learner_that_comes_back_is_waited_for(config: RunConfig) -> None:
    desk = Desk(config)
    away = LearnerUnreachableError("away")
    desk.answers = [desk.task(5), away, away, desk.task(5, "two")]
    desk.acks = [Ack("stale", reason="the weights were those of another learner")]
    heard: list[tuple[str, str]] = []
    evaluator = Evaluator(desk, on_event=lambda *event: heard.append(event))
    evaluator.run(threading.Event())
    assert [event for event, _ in heard] == ["joined", "stale", "validated"] and evaluator.done
    assert [result.learner_incarnation for result in desk.results] == ["one", "two"]


def test_another_configuration_is_taken_over(config: RunConfig) -> None:
    desk = Desk(config)
    learner = config.learner.model_copy(update={"validation_episodes": 2})
    desk.answers = [desk.task(5)]
    evaluator = Evaluator(desk)
    assert evaluator.round()
    desk.config = config.model_copy(update={"learner": learner})
    desk.answers = [desk.task(6)]
    assert evaluator.round()
    assert [result.sampled["episodes"] for result in desk.results] == [3, 2]


def test_nobody_there_is_a_sentence_unless_it_is_patient(config: RunConfig) -> None:
    desk = Desk(config, LearnerUnreachableError("no learner answers"))
    with pytest.raises(UserError, match="no learner answers"):
        Evaluator(desk).run(threading.Event())
    desk = Desk(config, LearnerUnreachableError("no learner answers"))
    evaluator = Evaluator(desk, patient=True)
    evaluator.run(threading.Event())
    assert evaluator.done


def test_a_stop_ends_a_round_without_a_word(config: RunConfig) -> None:
    desk = Desk(config)
    desk.answers = [desk.task(5)]
    stop = threading.Event()
    asked: list[int] = []

    def stopped() -> bool:
        asked.append(1)
        return len(asked) > 2

    assert not Evaluator(desk).round(stopped)
    assert desk.results == []
    stop.set()
    Evaluator(desk).run(stop)
