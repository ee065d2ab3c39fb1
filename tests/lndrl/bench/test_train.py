"""Figures of a whole training from its metrics; the training itself is the bench's."""

from __future__ import annotations

from typing import Any

import pytest
from rich.console import Console

from lndrl.bench import train
from lndrl.cli.main import run


def row(update: int) -> dict[str, Any]:
    """After ``update`` updates of 1000 samples, 10 s each; two actors, started 100 s earlier."""
    return {
        "steps": 50_000 + 1000 * update,
        "lag": {"mean": 1.0},
        "time": {
            "unix": 1e9 + 10.0 * update,
            "actors": 2,
            "spent": {
                "learner": {"update": 77.0 + 8.0 * update, "wait": 5.0 + update, "other": update},
                "actors": {"simulate": 9.0 * update, "infer": 9.0 * update}
                | {"upload": 1.0 * update, "fetch": 0.0, "wait": 3.0 + update},
                "actor_steps": 2000 + 1000 * update,
            },
        },
    }


ROWS = [row(0), row(1), row(4)]


def test_figures_are_of_the_timed_updates_alone() -> None:
    figures = train.figures(ROWS)
    assert figures["steps_per_second"] == pytest.approx(100.0)
    assert figures["learner_busy"] == pytest.approx(0.9), "the 5 s before do not count"
    assert figures["overhead_learner"] == pytest.approx(1 / 9)
    assert figures["overhead_actor"] == pytest.approx(1 / 19)
    assert (figures["actors"], figures["updates"]) == (2, 2)


def test_profile_is_per_step_and_per_sample() -> None:
    profile = train._profile(ROWS)
    assert profile["actor"]["simulate"] == pytest.approx(9000.0)
    assert profile["actor"]["wait"] == pytest.approx(1000.0)
    assert profile["learner"] == pytest.approx({"update": 8e3, "wait": 1e3, "other": 1e3})


def test_profile_as_a_table() -> None:
    console = Console(width=100)
    with console.capture() as captured:
        profile = train._profile(ROWS) | {"simulate_parts": {"laser": 12.5}}
        console.print(train.profile_table(profile))
    lines = captured.get().splitlines()
    for words in (
        ["actor, per environment step", "20,000.0"],
        ["simulate", "9,000.0", "45.0 %"],
        ["laser, alone", "12.5"],
        ["overhead", "5.3 %"],
        ["learner, per sample", "10,000.0"],
        ["update", "8,000.0", "80.0 %"],
        ["overhead", "11.1 %"],
    ):
        assert any(all(word in line for word in words) for line in lines), words


def test_only_training_has_a_profile(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "world", "--profile"]) == 2
    assert "--profile goes with train, not with world" in capsys.readouterr().err
