"""What the parts measure, in the smallest that gives figures, on the CPU."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from lndrl.bench.gpu import acting, card, compiling, learning
from lndrl.bench.gpu.parts import Outcome, Tell
from lndrl.bench.gpu.plan import PRECISIONS, WAYS, Plan, rehearsal
from lndrl.errors import UserError
from lndrl.machine.threads import kept_threads

PLAN = replace(rehearsal(), seconds=0.001, observations=16, batches=(4,), minibatches=(32,))


@pytest.fixture(autouse=True)
def _threads() -> Iterator[None]:
    with kept_threads():
        yield


def figures(work: Callable[[Tell, Plan], None], plan: Plan = PLAN) -> dict[str, Any]:
    outcome = Outcome()
    work(outcome.add, plan)
    return outcome.figures


def test_a_card_is_named_and_computes() -> None:
    found = figures(card.measure)
    assert found["name"] and found["bfloat16_teraflops"] > 0
    assert found["difference_of_a_product"] == 0.0, "of the CPU to itself"


def test_a_card_that_computes_something_else_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(card, "_TOLERANCE", 0.0)
    with pytest.raises(UserError, match="a product on cpu is 0 off that on the CPU"):
        figures(card.measure)


@pytest.mark.parametrize(("work", "size"), [(acting.measure, "4"), (learning.measure, "32")])
def test_every_precision_is_measured_both_ways(work: Callable[..., None], size: str) -> None:
    rates = figures(work)["samples_per_second"]
    assert list(rates) == list(PRECISIONS)
    for ways in rates.values():
        assert list(ways) == list(WAYS) and all(sizes[size] > 0 for sizes in ways.values())


def test_log_probabilities_are_compared_with_the_cpus() -> None:
    difference = figures(acting.measure)["difference"]
    assert max(difference["float32"].values()) < 1e-5
    assert 0 < max(difference["bfloat16"].values()) < 0.1


def test_what_cannot_be_measured_leaves_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    real = acting.acting_rate

    def sometimes(runner: Any, met: Any, batch: int, seconds: float) -> float:
        if batch == 8:
            raise RuntimeError("out of memory")
        return real(runner, met, batch, seconds)

    monkeypatch.setattr(acting, "acting_rate", sometimes)
    outcome = Outcome()
    with pytest.raises(UserError, match="4 of 12 failed, the first is float32 no_graphs 8: Run"):
        acting.measure(outcome.add, replace(PLAN, batches=(4, 8)))
    assert outcome.figures["samples_per_second"]["bfloat16"]["graphs"].keys() == {"4"}
    assert outcome.figures["errors"]["bfloat16 graphs 8"] == "RuntimeError: out of memory"


def test_kernels_are_counted_from_both_ends() -> None:
    for work, end in ((compiling.in_order, "in_order"), (compiling.from_behind, "from_behind")):
        assert figures(work)["compiled"][end] >= 0
