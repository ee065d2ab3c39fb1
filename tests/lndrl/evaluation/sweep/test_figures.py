from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lndrl.evaluation.sweep import Estimate, sweep_figures
from lndrl.evaluation.sweep.figures import arrival_curve, compare, run_figures, totals
from tests.lndrl.evaluation.sweep.helpers_sweep import rows_of, small_sweep, write_run

HALF = ["arrived", "lost"] * 450
LEARNING = ["collided"] * 600 + ["arrived"] * 300


def test_rates_of_the_last_third_count_every_episode_once() -> None:
    figures = run_figures("base", 1, rows_of(LEARNING, 9000, 30), {})
    assert (figures.steps, figures.episodes) == (9000, 300)
    assert figures.values["arrived"] == pytest.approx(1.0)
    assert figures.values["collided"] == pytest.approx(0.0)
    assert figures.values["return"] == pytest.approx(np.mean(range(600, 900)), rel=1e-3)
    assert figures.values["kl"] == pytest.approx(0.01)
    assert figures.values["steps_per_second"] == pytest.approx(9000 / 60.0)
    # 0 up to step 6000, then up by a window of 200 episodes, 2000 steps, and 1 for the rest;
    # every row stands for the 300 steps before it.
    ramp = [min(i * 30 / 200, 1.0) for i in range(1, 11)]
    assert figures.values["area"] == pytest.approx(sum(ramp) / 30)


def test_means_of_updates_are_those_of_the_last_third() -> None:
    rows = rows_of(HALF, 9000, 30)
    for row in rows:
        row["ppo"] |= {"kl": float(row["steps"] > 6000), "entropy": float("nan")}
    values = run_figures("base", 1, rows, {}).values
    assert values["kl"] == 1.0
    assert values["entropy"] is None


@pytest.mark.parametrize("sessions", [(), (7,), (3, 20, 21)])
@pytest.mark.parametrize("updates", [30, 23, 3])  # 3: more new episodes than a window holds
def test_totals_come_from_windows(sessions: tuple[int, ...], updates: int) -> None:
    rng = np.random.default_rng(3)
    outcomes = rng.choice(["arrived", "lost"], 900, p=[0.3, 0.7]).tolist()
    rows = rows_of(outcomes, 9000, updates, sessions)
    truth = [outcomes[: row["episodes"]["count"]].count("arrived") for row in rows]
    slack = 25 if updates == 3 else 8
    assert totals(rows, "arrived") == pytest.approx(truth, abs=slack)


def test_a_resume_leaves_no_dent_in_the_curve() -> None:
    rng = np.random.default_rng(4)
    outcomes = rng.choice(["arrived", "lost"], 900).tolist()
    whole = arrival_curve(rows_of(outcomes, 9000, 60))
    resumed = arrival_curve(rows_of(outcomes, 9000, 60, sessions=(30,)))
    assert resumed == pytest.approx(whole, abs=0.02)
    assert whole[-1] == pytest.approx(outcomes[-200:].count("arrived") / 200, abs=0.02)


def test_a_run_without_an_ended_episode_has_no_rates() -> None:
    figures = run_figures("base", 1, rows_of([], 1000, 5), {})
    assert figures.values["arrived"] is None and figures.values["area"] == 0.0


def test_estimates_are_students() -> None:
    estimate = Estimate.of([1.0, 2.0, 3.0])
    assert (estimate.mean, estimate.deviation) == (2.0, 1.0)
    # 2 -+ 4.3027 / sqrt(3)
    assert estimate.interval == pytest.approx((-0.484138, 4.484138), abs=1e-5)
    assert not estimate.clear
    assert Estimate.of([2.0, 2.1, 2.2]).clear
    assert Estimate.of([-2.0, -2.1]).clear
    assert not Estimate.of([5.0]).clear and Estimate.of([5.0]).interval is None
    assert not Estimate.of([0.0, 0.0]).clear
    assert Estimate.of([]).mean is None


def test_differences_are_paired_by_seed(tmp_path: Path) -> None:
    sweep, _ = small_sweep(tmp_path, seeds=[1, 2, 3])
    arrived = {
        "base": {1: 0.1, 2: 0.5, 3: 0.9},
        "one": {1: 0.21, 2: 0.6, 3: 0.99},  # always 0.1 more, though the seeds differ by 0.4
        "eight": {2: 0.4},
    }
    rows = rows_of(HALF, 900, 30)
    runs = []
    for name, seeds in arrived.items():
        for seed, rate in seeds.items():
            figures = run_figures(name, seed, rows, {})
            figures.values["arrived"] = rate
            runs.append(figures)
    base, one, eight = compare(sweep, runs, [("eight", 3)])
    assert base.differences == {}
    assert one.estimates["arrived"].deviation == pytest.approx(0.390, abs=1e-3)
    difference = one.differences["arrived"]
    assert difference.count == 3 and difference.mean == pytest.approx(0.1)
    assert difference.to_dict()["standard_error"] == pytest.approx(0.01 / 3**0.5)
    assert difference.clear
    assert eight.differences["arrived"].count == 1
    assert eight.differences["arrived"].mean == pytest.approx(-0.1)
    assert eight.diverged == (3,)


def test_only_finished_runs_count(tmp_path: Path) -> None:
    sweep, folder = small_sweep(tmp_path)
    runs = sweep.runs()
    write_run(folder, runs[0], rows_of(HALF, 1000, 10))
    write_run(folder, runs[1], rows_of(HALF, 500, 5), "begun")
    write_run(folder, runs[2], rows_of(HALF, 500, 5), "diverged")
    figures = sweep_figures(folder)
    assert [(run.variant, run.seed) for run in figures.runs] == [("base", 1)]
    assert [variant.seeds for variant in figures.variants] == [(1,), (), ()]
    assert [variant.diverged for variant in figures.variants] == [(), (), (1,)]
