"""How turns of one rank and of two become a speedup."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from lndrl.bench.ranks import MINIBATCH, _turns


class Worker:
    """Takes as long as it is told, turn by turn."""

    def __init__(self, seconds: list[float], losses: list[float]) -> None:
        self.seconds: Iterator[float] = iter(seconds)
        self.losses = losses
        self.gone = 0

    def go(self) -> None:
        self.gone += 1

    def word(self) -> dict[str, Any]:
        return {"seconds": next(self.seconds), "losses": self.losses}


def test_the_slowest_rank_counts_and_the_median_of_neighbouring_turns() -> None:
    alone = [Worker([9.0, 2.0, 2.0, 4.0, 2.0, 2.0], [1.0, -2.0])]
    both = [
        Worker([9.0, 1.0, 1.0, 2.0, 0.5, 1.0], [1.0, -2.0]),
        Worker([9.0, 0.5, 2.0, 2.0, 0.5, 0.5], [1.0, -2.002]),
    ]
    found = _turns(alone, both, 1.0)  # type: ignore[arg-type]
    assert (found["turns"], [worker.gone for worker in both]) == (5, [6, 6])
    assert (found["speedup"], found["speedup_least"], found["speedup_most"]) == (2.0, 1.0, 4.0)
    assert found["one_rank_samples_per_second"] == MINIBATCH * 2 / 2.0
    assert found["loss_difference"] == 0.0, "of what rank 0 says"


def test_losses_that_differ_are_told() -> None:
    alone, both = [Worker([1.0] * 6, [1.0, -2.0])], [Worker([1.0] * 6, [1.0, -2.002])]
    found = _turns(alone, both, 1.0)  # type: ignore[arg-type]
    assert found["loss_difference"] == pytest.approx(1e-3)
