"""Driving for returns: the episodes of evaluate, paid as in training, compared pair by pair."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from dataclasses import replace
from io import StringIO
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation import BLOCK, EpisodeRunner, evaluate
from lndrl.evaluation.returns import (
    PlannerReturns,
    ReturnsReport,
    drive_returns,
    paid_as,
    returns_tables,
)
from lndrl.navigation import REWARD_PARTS, Navigation
from lndrl.navigation.terms import learning_reward
from lndrl.planners import PlannerSource

DISCOUNTS = (0.9, 1.0)
STRAIGHT, RANDOM = PlannerSource("straight"), PlannerSource("random")
SCENARIO = {
    "name": "room",
    "size": [9, 6],
    "pedestrians": {
        "count": [2, 2],
        "routes": [{"start": [4, 1, 5, 2], "goal": [4, 2.5, 5, 3.5]}],
    },
    "robot": [{"start": [1, 1, 2, 5], "goal": [3, 1, 8, 5]}],
}


def made_config(reward: dict[str, Any] | None = None, **more: Any) -> RunConfig:
    return RunConfig.model_validate(
        {
            "scenario": SCENARIO,
            "seed": 4,
            "task": {"time_limit": 12.0, "reward": reward or {}},
            "localization": {"min_particles": 60, "max_particles": 100},
            "ppo": {"reward_scale": 0.01, "reward_limit": 5.0},
            **more,
        }
    )


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return made_config()


@pytest.fixture(scope="module")
def straight(config: RunConfig) -> PlannerReturns:
    return drive_returns(STRAIGHT, config, BLOCK + 2, DISCOUNTS)


def test_episodes_are_those_of_evaluate(config: RunConfig, straight: PlannerReturns) -> None:
    assert straight.result == evaluate(STRAIGHT, config, BLOCK + 2, seed=4)


def test_returns_are_those_of_a_slow_twin(config: RunConfig, straight: PlannerReturns) -> None:
    paid: dict[int, list[float]] = {}

    def watch(world: Navigation) -> None:
        rewards = paid.setdefault(world.world_id, [])
        if world.steps:
            rewards.append(float(world.track.reward[0]))

    list(EpisodeRunner(STRAIGHT, config)(range(3), watch))
    limited = 0
    for rewards, found in zip(paid.values(), straight.returns, strict=False):
        seen = learning_reward(np.array(rewards, np.float32), config.ppo).tolist()
        limited += sum(abs(each) >= 5.0 for each in seen)
        twin = [sum(each * d**t for t, each in enumerate(seen)) for d in DISCOUNTS]
        np.testing.assert_allclose(found, twin, rtol=1e-5)
    assert drive_returns(STRAIGHT, config, 3, DISCOUNTS).limited == limited > 0


def test_the_result_does_not_depend_on_the_number_of_workers(
    config: RunConfig, straight: PlannerReturns
) -> None:
    told: list[int] = []
    again = drive_returns(
        STRAIGHT, config, BLOCK + 2, DISCOUNTS, 2, progress=lambda record: told.append(record.world)
    )
    assert ReturnsReport("x", (again,)).to_dict() == ReturnsReport("x", (straight,)).to_dict()
    assert len(told) == BLOCK + 2 and multiprocessing.active_children() == []


def test_undiscounted_and_unscaled_it_is_the_episodes_return(config: RunConfig) -> None:
    plain = config.ppo.model_copy(update={"reward_scale": 1.0, "reward_limit": None})
    found = drive_returns(STRAIGHT, config.model_copy(update={"ppo": plain}), 2, (1.0,))
    assert found.limited == 0 and found.parts == REWARD_PARTS
    for record, sums in zip(found.result.records, found.sums[:, 0], strict=True):
        np.testing.assert_allclose(sums, [*record.reward_parts.values()], rtol=1e-6)


def test_own_terms_and_the_pose_limit_are_paid(own_module: Callable[..., str]) -> None:
    name = own_module("""
        import numpy as np

        class Bonus:
            def __init__(self, config):
                pass

            def __call__(self, steps):
                return np.ones(len(steps.steps))
    """)
    own = made_config({"pose_limit": 0.04, "terms": {"bonus": {"use": f"{name}:Bonus"}}})
    own = own.model_copy(update={"ppo": own.ppo.model_copy(update={"reward_limit": None})})
    found = drive_returns(STRAIGHT, own, 2, (1.0,))
    assert found.parts == (*REWARD_PARTS, "bonus")
    steps = [record.steps for record in found.result.records]
    np.testing.assert_allclose(found.sums[:, 0, -1], 0.01 * np.array(steps), rtol=1e-5)
    pose = REWARD_PARTS.index("pose")
    free = drive_returns(STRAIGHT, made_config(), 2, (1.0,))
    assert np.abs(found.sums[:, 0, pose]).max() <= 0.01 * 0.04 + 1e-9, "from no error to the limit"
    assert np.abs(free.sums[:, 0, pose]).min() > 0.01


def test_untrusted_terms_are_refused(own_module: Callable[..., str]) -> None:
    name = own_module("raise RuntimeError\n", trusted=False)
    with pytest.raises(UserError, match="is refused"):
        drive_returns(STRAIGHT, made_config({"terms": {"b": {"use": f"{name}:B"}}}), 1, (1.0,))


@pytest.mark.parametrize("discount", [0.0, 1.2, float("nan")])
def test_a_discount_that_is_none_is_refused(config: RunConfig, discount: float) -> None:
    with pytest.raises(ValueError, match="above 0 and at most 1"):
        drive_returns(STRAIGHT, config, 1, (discount,))


def test_differences_are_paired(config: RunConfig, straight: PlannerReturns) -> None:
    above = replace(straight, sums=straight.sums + 0.5 / straight.sums.shape[2])
    for estimate in above.differences(straight):
        assert estimate.mean == pytest.approx(0.5)
        assert estimate.clear, "what is the same in every pair is sure, however pairs differ"
    spread = straight.estimates[0].interval
    assert spread is not None and spread[1] - spread[0] > 0.1
    random = drive_returns(RANDOM, config, BLOCK + 2, DISCOUNTS)
    for d, estimate in enumerate(random.differences(straight)):
        pairs = random.returns[:, d] - straight.returns[:, d]
        half = 2.2622 * pairs.std(ddof=1) / np.sqrt(len(pairs))  # Student's, 9 degrees
        assert estimate.interval == pytest.approx((pairs.mean() - half, pairs.mean() + half), 1e-4)


def test_only_the_same_episodes_are_compared(config: RunConfig, straight: PlannerReturns) -> None:
    for other in (
        drive_returns(STRAIGHT, config, 2, DISCOUNTS),
        replace(straight, discounts=(0.8, 1.0)),
        replace(straight, config=config.model_copy(update={"seed": 5})),
        replace(straight, config=made_config({"lost": -2000.0})),
    ):
        with pytest.raises(ValueError, match="same episodes"):
            other.differences(straight)


def test_a_policy_keeps_its_eyes_and_is_paid_as_the_base() -> None:
    base = made_config({"lost": -2000.0}, world={"robot_radius": 0.2})
    own = made_config(network={"features": 8})
    own = own.model_copy(update={"task": own.task.model_copy(update={"map_cells": 24})})
    config = paid_as(base, PlannerSource("policy", own, b"weights"))
    assert (config.task.map_cells, config.network.features) == (24, 8)
    assert config.task.reward == base.task.reward and config.ppo == base.ppo
    assert config.world == base.world and config.seed == base.seed
    assert paid_as(base, STRAIGHT) is base


def printed(report: ReturnsReport, width: int, all_parts: bool = False) -> str:
    console = Console(file=StringIO(), width=width, force_terminal=False)
    for table in returns_tables(report, all_parts):
        console.print(table)
    assert isinstance(console.file, StringIO)
    return console.file.getvalue()


def test_tables_fit_a_narrow_terminal(straight: PlannerReturns) -> None:
    named = replace(straight.result, planner=f"runs/{'x' * 40}")
    other = replace(straight, result=named, sums=2.0 * straight.sums)
    report = ReturnsReport("lndrl", (straight, other))
    for width in (66, 80):
        narrow = printed(report, width)
        assert "…" not in narrow and max(map(len, narrow.splitlines())) <= width
    wide = " ".join(printed(report, 200).split())
    mean = float(straight.returns[:, 1].mean())
    assert f" {2.0 * mean:.2f} " in wide and f" +{mean:.2f} * " in wide
    assert "Δ: above straight in the same episodes" in wide
    assert "reward of lndrl, × 0.01, limited to ±5" in wide
    assert "adds at discount 1" in wide and "0.9" in printed(report, 200, True)
    alone = printed(ReturnsReport("lndrl", (straight,)), 200)
    assert "Δ" not in alone and "leaves 0 out" not in alone
