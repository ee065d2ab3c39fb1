"""Which rows are trained alike, and what chance is worth between them."""

from __future__ import annotations

import math

import pytest

from lndrl.evaluation.benchmark import BenchmarkSpec, load_benchmark
from lndrl.evaluation.benchmark.results import Repeated, repeated
from tests.lndrl.evaluation.benchmark.results.rows import row, share


def bench(**methods: dict) -> BenchmarkSpec:
    return BenchmarkSpec.model_validate({"scenarios": ["sparse"], "methods": methods})


def alike(spec: BenchmarkSpec, *names: str) -> list[list[str]]:
    rows = [row(name, "al") for name in names or spec.methods]
    return [each.methods for each in repeated(spec, rows)]


def test_of_the_bench_only_the_seeds_of_lndrl_are_alike() -> None:
    assert alike(load_benchmark()) == [["lndrl", "lndrl-seed2", "lndrl-seed3"]]


def test_a_row_without_a_configuration_is_alike_to_one_that_names_it() -> None:
    found = bench(
        own={"planner": "runs/own"},
        again={"planner": "runs/own-seed2", "config": "own.yaml", "seed": 2},
        third={"planner": "runs/third", "config": "own", "seed": 3},
    )
    assert alike(found) == [["own", "again", "third"]]
    assert alike(found, "third", "again") == [["third", "again"]]
    assert alike(found, "own") == alike(found, "own", "stranger") == []


@pytest.mark.parametrize(
    "other",
    [
        {"shield": True},
        {"guard": True},
        {"localization": "perfect"},
        {"temperature": 0.25},
        {"config": "other"},
        {"planner": "runs/own"},  # the same training, tested twice
    ],
)
def test_rows_that_differ_in_more_than_chance_are_not_alike(other: dict) -> None:
    second = {"planner": "runs/own-seed2", "config": "own", "seed": 2} | other
    assert alike(bench(own={"planner": "runs/own"}, second=second)) == []


def test_rules_are_not_trained() -> None:
    assert alike(bench(one={"planner": "dwa"}, two={"planner": "careful"})) == []


def test_a_shielded_row_has_the_configuration_of_the_run_that_it_tests() -> None:
    shielded = {f"s{seed}": {"planner": f"runs/{seed}", "shield": True} for seed in (1, 2)}
    plain = {str(s): {"planner": f"runs/{s}", "config": "own", "seed": s} for s in (1, 2)}
    assert alike(bench(**shielded, **plain)) == [["s1", "s2"], ["1", "2"]]


def test_mean_and_interval_are_those_of_the_trainings() -> None:
    found = Repeated(tuple(row(str(n), share(n, 100, 40)) for n in (1800, 1840, 1850)))
    arrived = found.over_trainings("arrived")
    assert arrived.mean == pytest.approx(0.915)
    assert arrived.deviation is not None
    assert arrived.deviation == pytest.approx(math.sqrt(0.000175))
    # Student's quantile of two degrees of freedom, from a printed table.
    half = 4.302653 * arrived.deviation / math.sqrt(3)
    assert arrived.interval == pytest.approx((0.915 - half, 0.915 + half), abs=1e-6)
    assert found.over_trainings("lost").interval == pytest.approx((0.05, 0.05))
    assert found.chance("collided") == 0.0
    told = found.to_dict()
    assert told["methods"] == ["1800", "1840", "1850"]
    assert told["arrived"]["chance"] == pytest.approx(4.302653 * math.sqrt(2 * 0.000175), abs=1e-6)
