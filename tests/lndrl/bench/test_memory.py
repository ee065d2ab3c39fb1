"""What actor and learner hold: built in processes of their own, and watched in a training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lndrl.bench import memory
from lndrl.bench.scene import with_settings
from lndrl.errors import UserError

SMALL = ["network.map_channels=[4, 4, 4]", "network.features=16", "ppo.batch_size=256"]
SMALL += ["actor.horizon=8", "actor.worlds=2", "ppo.minibatch_size=64"]


def test_both_are_built_by_part(tmp_path: Path) -> None:
    with with_settings(SMALL):
        actor, learner = (memory._parts(role, tmp_path) for role in ("actor", "learner"))
    assert list(actor) == [
        "interpreter", "numpy and numba", "other libraries", "worlds, kernels, room for weights",
        "weights", "a chunk", "all",
    ]  # fmt: skip
    assert learner["torch"] > 100.0 and learner["all"] > actor["all"]
    for parts in (actor, learner):
        assert parts["all"] == pytest.approx(sum(parts.values()) - parts["all"])
    assert actor["all"] < learner["torch"] + actor["interpreter"] + 200.0, "an actor has no torch"


def test_a_part_that_fails_is_a_sentence(tmp_path: Path) -> None:
    with with_settings(["scenario=nowhere"]), pytest.raises(UserError, match="actor ended early"):
        memory._parts("actor", tmp_path)


def test_of_a_training_medians_and_peaks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [{"steps": k, "time": {"unix": 10.0 * k}} for k in range(20)]

    class Fake:
        def __init__(self, *_: Any) -> None:
            self.looks = 0

        def __enter__(self) -> Fake:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def megabytes(self) -> tuple[float, float]:
            self.looks += 1
            return 900.0 + (self.looks == 3), 300.0 + (self.looks == 2)

        def wait(self, done: Any, interval: float) -> None:
            for n in range(20):
                if done(rows[:n]):
                    return

    monkeypatch.setattr(memory, "Training", Fake)
    assert memory._training(5.0, tmp_path) == {
        "actor_median": 300.0, "actor_largest": 301.0,
        "learner_median": 900.0, "learner_largest": 901.0,
    }  # fmt: skip
