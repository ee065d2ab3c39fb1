"""How many actors: the first choice by arithmetic, the later ones from shares of waiting."""

from __future__ import annotations

import pytest

from actors.balance import Balance, first_choice
from lndrl.config import REPOSITORY_CONFIGS, load_config


def configured(*overrides: str):
    return load_config(REPOSITORY_CONFIGS / "lndrl.yaml", overrides)


@pytest.mark.parametrize(
    ("cores", "device", "actors", "threads"),
    [
        (1, "cpu", 1, 1),
        (2, "cpu", 1, 2),
        (4, "cpu", 1, 3),
        (16, "cpu", 3, 13),
        (2, "cuda", 1, 2),
        (16, "cuda", 14, 2),
    ],
)
def test_first_choice(cores: int, device: str, actors: int, threads: int) -> None:
    choice = first_choice(configured("ppo.epochs=2"), cores, device)
    assert (choice.actors, choice.learner_threads) == (actors, threads)


def test_more_epochs_leave_fewer_cores_to_actors() -> None:
    actors = [first_choice(configured(f"ppo.epochs={n}"), 64).actors for n in (1, 2, 4, 10)]
    assert actors == sorted(actors, reverse=True) and actors[0] > actors[-1] >= 1


def test_configured_numbers_stay() -> None:
    fixed = configured("actor.count=5", "actor.worlds=3", "learner.threads=2")
    assert first_choice(fixed, 16) == first_choice(fixed, 2)
    assert first_choice(fixed, 16).actors == 5 and first_choice(fixed, 16).worlds == 3
    assert first_choice(configured("learner.mode=lockstep"), 64, "cuda").actors == 2


@pytest.mark.parametrize("cores", [1, 2, 8, 16, 64, 256])
def test_chunks_are_small_beside_batches_and_fresh(cores: int) -> None:
    config = configured()
    choice = first_choice(config, cores, "cuda")
    chunk = choice.worlds * config.actor.horizon
    assert chunk <= config.ppo.batch_size / 2
    assert choice.actors * chunk <= config.learner.max_lag / 2 * config.ppo.batch_size
    assert 1 <= choice.worlds <= 32
    assert config.worlds_per_actor() == 32, "two actors make a batch of two chunks"


class Run:
    """A controller against shares that depend on the number of actors."""

    def __init__(self, most: int, shares: dict[int, tuple[float, float]], actors: int = 1) -> None:
        self.balance = Balance(most)
        self.shares = shares
        self.actors = actors
        self.now = 1000.0
        self.changes: list[tuple[float, int]] = []

    def go(self, seconds: float, settled: bool = True) -> Run:
        for _ in range(int(seconds / 0.25)):
            self.now += 0.25
            waits, idle = self.shares[self.actors]
            advice = self.balance.advise(self.now, self.actors, waits, idle, settled)
            assert advice in (-1, 0, 1)
            if advice:
                self.actors += advice
                self.changes.append((self.now - 1000.0, self.actors))
        return self


def test_grows_until_the_learner_no_longer_waits() -> None:
    run = Run(8, {1: (0.6, 0.0), 2: (0.3, 0.0), 3: (0.05, 0.1), 4: (0.0, 0.7)}).go(3600.0)
    assert [actors for _, actors in run.changes] == [2, 3]
    first, second = (at for at, _ in run.changes)
    assert first >= Balance.HOLD and second - first >= Balance.REST


def test_shrinks_while_actors_idle_but_keeps_one() -> None:
    run = Run(8, {n: (0.0, 1 - 0.3 / n) for n in range(1, 5)}, actors=4).go(3600.0)
    assert [actors for _, actors in run.changes] == [3, 2, 1]


def test_never_more_than_cores() -> None:
    run = Run(2, {1: (0.9, 0.0), 2: (0.9, 0.0)}).go(3600.0)
    assert run.actors == 2 and len(run.changes) == 1


def test_actors_that_idle_too_are_not_joined_by_more() -> None:
    assert Run(8, {1: (0.5, 0.8)}).go(600.0).changes == []


def test_a_moment_changes_nothing() -> None:
    run = Run(8, {1: (0.0, 0.0)})
    for _ in range(50):
        run.shares = {1: (0.5, 0.0)}
        run.go(Balance.HOLD - 1.0)
        run.shares = {1: (0.05, 0.0)}
        run.go(1.0)
    assert run.changes == []


def test_between_two_numbers_it_changes_ever_more_rarely() -> None:
    run = Run(4, {1: (0.3, 0.0), 2: (0.0, 0.7)}).go(4 * 3600.0)
    gaps = [b - a for (a, _), (b, _) in zip(run.changes, run.changes[1:], strict=False)]
    assert gaps == sorted(gaps)
    assert len(run.changes) <= 15 and gaps[-1] >= Balance.LONGEST_REST


def test_unsettled_times_do_not_count() -> None:
    run = Run(8, {1: (0.9, 0.0), 2: (0.0, 0.0)})
    assert run.go(3600.0, settled=False).changes == []
    began = run.now - 1000.0
    run.go(60.0)
    [(at, _)] = run.changes
    assert at - began >= Balance.WINDOW - 1.0, "the shares must stem from settled times alone"
