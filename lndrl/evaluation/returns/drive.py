"""Driving validation episodes and adding up what a learner would be paid in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lndrl.config import RunConfig
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.estimate import Estimate
from lndrl.evaluation.pool import Work
from lndrl.evaluation.result import EvaluationResult
from lndrl.evaluation.returns.discount import Floats, discounted_sums, learning_parts
from lndrl.evaluation.runner import check_complete, driving, in_world_of, result_of
from lndrl.navigation import EpisodeRecord, Navigation
from lndrl.navigation.families import Family
from lndrl.planners import PlannerSource
from lndrl.policy import act_on_one_thread


@dataclass(frozen=True, eq=False)
class EpisodeReturns:
    """One episode: ``sums`` (D, P) are its discounted returns, a row per discount and a column per
    part of the reward; ``limited`` the control steps whose reward a limit cut.
    """

    record: EpisodeRecord
    sums: Floats
    limited: int


@dataclass(frozen=True, eq=False)
class PlannerReturns:
    """One planner's episodes in their order, and what they came to under ``config``."""

    result: EvaluationResult
    config: RunConfig
    discounts: tuple[float, ...]
    parts: tuple[str, ...]
    sums: Floats  # (N, D, P) per episode, discount and part
    limited: int  # control steps of all episodes

    @property
    def returns(self) -> Floats:
        """(N, D) per episode and discount, all parts together."""
        returns: Floats = self.sums.sum(axis=2)
        return returns

    @property
    def estimates(self) -> list[Estimate]:
        """The mean return at each discount."""
        return _estimates(self.returns)

    def differences(self, first: PlannerReturns) -> list[Estimate]:
        """By how much the return is above that of ``first`` in the same episode, at each discount.

        Raises ValueError where the episodes, their world or the discounts are not the same.
        """
        if self._played() != first._played():
            raise ValueError("only the same episodes can be compared")
        return _estimates(self.returns - first.returns)

    def _played(self) -> object:
        config = self.config
        reward = config.task.reward, config.ppo.reward_scale, config.ppo.reward_limit
        world = config.seed, config.scenario, config.world, config.localization
        return reward, world, self.discounts, len(self.sums)


def paid_as(base: RunConfig, source: PlannerSource) -> RunConfig:
    """What ``source`` is driven under to be paid by ``base``, in its world.

    A policy sees and does what it was trained to; all else is that of ``base``.
    """
    if source.config is None:
        return base
    config = in_world_of(base, source.config)
    task = config.task.model_copy(update={"reward": base.task.reward})
    return config.model_copy(update={"task": task, "ppo": base.ppo})


def drive_returns(
    source: PlannerSource,
    config: RunConfig,
    episodes: int,
    discounts: Sequence[float],
    workers: int = 0,
    greedy: bool = False,
    progress: Callable[[EpisodeRecord], None] | None = None,
) -> PlannerReturns:
    """Drive validation episodes 0 to ``episodes`` - 1 of ``config.seed``, paid as in training.

    Rewards are those of ``config``: its weights, ``pose_limit`` and own terms, scaled and limited
    as its ``ppo`` says. A timeout is an end here: no value is added for what would have followed.
    ``workers`` and ``progress`` as in ``evaluate``.

    Raises UserError as ``evaluate`` does, and for own terms that this process does not trust;
    ValueError for a discount outside (0, 1].
    """
    if not all(0.0 < discount <= 1.0 for discount in discounts):
        raise ValueError(f"discounts must be above 0 and at most 1, not {discounts}")
    found: list[EpisodeReturns] = []
    arguments = (source, config, greedy, tuple(discounts))
    with driving(_make_work, arguments, episodes, workers) as results:
        for each in results:
            found.append(each)
            if progress is not None:
                progress(each.record)
    found.sort(key=lambda each: each.record.world)
    records = [each.record for each in found]
    check_complete(records, episodes)
    return PlannerReturns(
        result=result_of(source, config, greedy, records),
        config=config,
        discounts=tuple(discounts),
        parts=tuple(records[0].reward_parts),
        sums=np.stack([each.sums for each in found]),
        limited=sum(each.limited for each in found),
    )


class _Paid:
    """A worker: runs episodes and keeps what each step paid until the episode ends."""

    def __init__(self, runner: EpisodeRunner, discounts: Sequence[float]) -> None:
        self._runner, self._discounts = runner, discounts

    def __call__(self, episodes: Sequence[int]) -> Iterator[EpisodeReturns]:
        steps: dict[int, list[Floats]] = {self._runner.family.world(k): [] for k in episodes}

        def watch(world: Navigation) -> None:
            if world.steps:
                steps[world.world_id].append(world.parts())

        for record in self._runner(episodes, watch):
            parts, limited = learning_parts(
                np.array(steps.pop(record.world)), self._runner.config.ppo
            )
            sums = discounted_sums(parts, self._discounts)
            yield EpisodeReturns(record, sums, int(limited.sum()))


def _make_work(
    source: PlannerSource, config: RunConfig, greedy: bool, discounts: Sequence[float]
) -> Work:
    if source.weights is not None:
        act_on_one_thread(config)
    return _Paid(
        EpisodeRunner(source, config, greedy, Family.VALIDATION, as_trained=True), discounts
    )


def _estimates(values: Floats) -> list[Estimate]:
    """Of ``values`` (N, D), one per column."""
    return [Estimate.of(column.tolist()) for column in values.T]
