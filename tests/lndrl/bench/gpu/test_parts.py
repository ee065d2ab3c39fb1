"""Parts within a budget: who gets how much, who is skipped, and that none harms another."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from lndrl.bench.gpu.parts import (
    DONE,
    FAILED,
    SHORT,
    SKIPPED,
    WAITING,
    Attempts,
    Outcome,
    Outcomes,
    OutOfTimeError,
    Part,
    Tell,
    measure_parts,
)
from lndrl.errors import UserError


class Stage:
    """Parts that take ``takes`` s of a clock of their own, and remember what they were allowed."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.allowed: dict[str, float] = {}
        self.kept: list[dict[str, Outcome]] = []
        self.said: list[str] = []

    def part(
        self,
        name: str,
        share: float,
        takes: float,
        least: float = 1.0,
        error: BaseException | None = None,
        borrows: bool = False,
    ) -> Part:
        def measure(tell: Tell, deadline: float) -> None:
            self.allowed[name] = deadline - self.now
            self.now += takes
            tell(takes, "took", "s")
            if error is not None:
                raise error

        return Part(name, share, least, measure, borrows)

    def run(self, *parts: Part, seconds: float) -> dict[str, Outcome]:
        def keep(outcomes: Outcomes) -> None:
            self.kept.append(copy.deepcopy(dict(outcomes)))

        return measure_parts(parts, seconds, keep, self.said.append, lambda: self.now)


def test_shares_are_of_the_whole_and_what_is_left_goes_on() -> None:
    stage = Stage()
    parts = [stage.part("a", 10, 5), stage.part("b", 20, 40), stage.part("c", 30, 1)]
    outcomes = stage.run(*parts, seconds=120)
    assert stage.allowed == {"a": 20, "b": 55, "c": 75}
    assert {name: outcome.share for name, outcome in outcomes.items()} == {
        "a": 20,
        "b": 40,
        "c": 60,
    }
    assert outcomes["b"].figures == {"took": {"s": 40}} and outcomes["b"].seconds == 40
    assert all(outcome.state == DONE for outcome in outcomes.values())
    assert stage.said[:2] == ["a, at most 20 s", "a: done after 5 s"]


def test_who_took_too_long_costs_the_last() -> None:
    stage = Stage()
    parts = [stage.part("a", 10, 30), stage.part("b", 10, 10), stage.part("c", 20, 1, least=5)]
    outcomes = stage.run(*parts, seconds=40)
    assert stage.allowed == {"a": 10, "b": 10}
    assert outcomes["c"].state == SKIPPED and outcomes["c"].seconds == 0
    assert outcomes["c"].why == "0 s were left for it, 5 are the least it takes"


def test_a_part_that_borrows_leaves_the_others_their_least() -> None:
    stage = Stage()
    parts = [stage.part("a", 10, 15, borrows=True), stage.part("b", 30, 1, least=12)]
    stage.run(*parts, seconds=40)
    assert stage.allowed == {"a": 28, "b": 25}


def test_a_part_that_fails_or_ends_too_late_leaves_its_figures_and_the_rest_goes_on() -> None:
    stage = Stage()
    outcomes = stage.run(
        stage.part("odd", 10, 1, error=ValueError("two\nlines")),
        stage.part("user", 10, 1, error=UserError("a sentence")),
        stage.part("slow", 10, 1, error=OutOfTimeError("half of it")),
        stage.part("good", 10, 1),
        seconds=40,
    )
    found = {name: (outcome.state, outcome.why) for name, outcome in outcomes.items()}
    assert found == {
        "odd": (FAILED, "ValueError: two lines"),
        "user": (FAILED, "a sentence"),
        "slow": (SHORT, "half of it"),
        "good": (DONE, ""),
    }
    assert all(outcome.figures == {"took": {"s": 1}} for outcome in outcomes.values())


def test_what_is_known_is_kept_before_after_and_at_every_figure() -> None:
    stage = Stage()
    with pytest.raises(KeyboardInterrupt):
        stage.run(
            stage.part("a", 10, 2),
            stage.part("b", 10, 3, error=KeyboardInterrupt()),
            stage.part("c", 10, 1),
            seconds=30,
        )
    states = [[outcome.state for outcome in kept.values()] for kept in stage.kept]
    assert states[0] == [WAITING] * 3
    assert ["measuring", WAITING, WAITING] in states and [DONE, WAITING, WAITING] in states
    last = stage.kept[-1]
    assert last["b"].figures == {"took": {"s": 3}} and last["b"].why == "interrupted"
    assert last["c"].state == WAITING


def breaks() -> None:
    raise RuntimeError("capture failed")


def test_of_many_figures_those_that_can_are_measured() -> None:
    told: dict[tuple[str, ...], Any] = {}

    def tell(value: Any, *keys: str) -> None:
        told[keys] = value

    attempts = Attempts(tell)
    with attempts.one("float32", "64"):
        tell(1.0, "float32", "64")
    with attempts.one("bfloat16", "64"):
        breaks()
    assert told == {
        ("float32", "64"): 1.0,
        ("errors", "bfloat16 64"): "RuntimeError: capture failed",
    }
    with pytest.raises(UserError, match="1 of 2 failed, the first is bfloat16 64: RuntimeError: "):
        attempts.settle()
    with pytest.raises(OutOfTimeError), attempts.one("x"):
        raise OutOfTimeError
    Attempts(tell).settle()
