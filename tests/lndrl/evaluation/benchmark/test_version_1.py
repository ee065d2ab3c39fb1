"""Version 1 of the bench, kept: same hashes, same numbers, bit for bit."""

from __future__ import annotations

import csv
from itertools import groupby
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field

from lndrl.config import find
from lndrl.config.localization import LocalizationConfig
from lndrl.config.world import WorldConfig
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    BenchmarkSpec,
    bench_config,
    bench_hash,
    check_frozen,
    contenders,
    load_benchmark,
)
from lndrl.evaluation.benchmark import spec as spec_module
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.models import LATER
from lndrl.navigation.families import Family

STORED = Path(__file__).with_name("version-1.csv")
"""Episodes 0 and 1 of two methods in five scenarios, as an Intel and an AMD machine wrote them."""


@pytest.fixture(scope="module")
def bench() -> BenchmarkSpec:
    return load_benchmark(find("bench", "benchmark-v1"))


def test_its_hashes_are_those_that_were_frozen(bench: BenchmarkSpec) -> None:
    (dwa,), _ = contenders(bench, ["dwa"])
    hashes = {s: bench_hash(bench_config(dwa, s, 0, bench.changes_in(s))) for s in bench.scenarios}
    assert hashes == bench.frozen
    check_frozen(bench, hashes)


def test_a_new_key_that_does_nothing_leaves_the_hashes_as_they_are(bench: BenchmarkSpec) -> None:
    class Grip(WorldConfig):
        grip: Annotated[float, LATER] = Field(1.0, description="a key of the future")

    class Compass(LocalizationConfig):
        compass: Annotated[bool, LATER] = Field(False, description="another one")

    (dwa,), _ = contenders(bench, ["dwa"])
    config = bench_config(dwa, "hall", 0, bench.changes_in("hall"))
    world, localization = config.world.model_dump(), config.localization.model_dump()
    neutral = {"world": Grip(**world), "localization": Compass(**localization)}
    assert bench_hash(config.model_copy(update=neutral)) == bench.frozen["hall"]
    set_ = {"world": Grip(**world, grip=0.5)}
    assert bench_hash(config.model_copy(update=set_)) != bench.frozen["hall"]


def test_other_numbers_make_it_another_bench(
    bench: BenchmarkSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    (dwa,), _ = contenders(bench, ["dwa"])
    monkeypatch.setattr(spec_module, "KERNEL_REVISION", 2)
    assert (
        bench_hash(bench_config(dwa, "hall", 0, bench.changes_in("hall"))) != bench.frozen["hall"]
    )
    with pytest.raises(UserError, match="frozen at kernel_revision 1, this program's is 2"):
        check_frozen(bench, {})


def test_the_delay_is_judged_as_it_was(bench: BenchmarkSpec) -> None:
    (dwa,), _ = contenders(bench, ["dwa"])
    then = bench_config(dwa, "hall", 0, bench.changes_in("hall"))
    now = bench_config(dwa, "hall", 0, [*bench.changes_in("hall"), "task.judged_moment=report"])
    assert bench_hash(now) != bench_hash(then)
    prompt = [*bench.changes_in("hall"), "localization.delay=0"]  # nothing is old: both judge alike
    assert bench_hash(bench_config(dwa, "hall", 0, prompt)) == bench_hash(
        bench_config(dwa, "hall", 0, [*prompt, "task.judged_moment=report"])
    )


@pytest.mark.parametrize("method", ["dwa", "random"])
def test_stored_episodes_are_driven_again(bench: BenchmarkSpec, method: str) -> None:
    """Red: the world, the filter, the task or the planner come to other numbers.

    Sums are as wide as the processor's registers, so machines with AVX2 and AVX-512 differ in the
    last digits; on one machine an episode repeats bit for bit (test_replay.py).

    Raise ``KERNEL_REVISION`` if that is on purpose, freeze the bench anew and store new episodes.
    """
    with STORED.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == method]
    assert len(rows) == 10
    (contender,), _ = contenders(bench, [method])
    for scenario, kept in groupby(rows, key=lambda row: row["scenario"]):
        config = bench_config(contender, scenario, bench.seed, bench.changes_in(scenario))
        runner = EpisodeRunner(contender.source, config, family=Family.BENCH)
        driven = {Family.BENCH.episode(r.world): r.to_dict() for r in runner(range(2))}
        for row in kept:
            record = driven[int(row["episode"])]
            figures = {**record, **record["reward_parts"]}
            names = [n for n in row if n not in ("method", "scenario", "episode")]
            words = [n for n in names if not isinstance(figures[n], float)]
            assert {n: str(figures[n]) for n in words} == {n: row[n] for n in words}, scenario
            numbers = {n: float(row[n]) for n in names if n not in words}
            assert {n: figures[n] for n in numbers} == pytest.approx(numbers, rel=1e-9, abs=1e-12)
