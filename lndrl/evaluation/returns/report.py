"""What several planners earned in the same episodes, as JSON has it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lndrl.evaluation.estimate import Estimate
from lndrl.evaluation.returns.drive import PlannerReturns
from lndrl.navigation.families import episode_of
from lndrl.version import VERSION

RATES = ("arrival", "collision", "lost", "stuck")
"""Of the nine metrics, those that say how episodes ended."""


@dataclass(frozen=True, eq=False)
class ReturnsReport:
    """Planners under one reward and in the same episodes; differences are to the first one.

    ``reward`` says in words whose reward it is: a configuration and what was set of it.
    """

    reward: str
    planners: tuple[PlannerReturns, ...]

    @property
    def discounts(self) -> tuple[float, ...]:
        """As they were asked for."""
        return self.planners[0].discounts

    @property
    def largest(self) -> float:
        """The discount that counts the most of an episode."""
        return max(self.discounts)

    def differences(self, planner: PlannerReturns) -> list[Estimate] | None:
        """By how much ``planner`` earns more than the first, per discount; None for the first."""
        return None if planner is self.planners[0] else planner.differences(self.planners[0])

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON. Episodes are in one order for all planners.

        ``reward``: its weights and limits, and the configuration's words (``of``). Each of
        ``planners`` has the rates of its outcomes, ``steps`` (mean, deviation), ``limited_steps``
        (share whose reward a limit cut), ``episodes`` with outcome, steps and ``returns`` in the
        order of ``discounts``, and ``discounted``: per discount ``return`` (mean, deviation,
        standard error, 95 % ``interval``), ``parts`` (means that add up to it), and, after the
        first planner, the paired ``difference`` to it, ``clear`` where its interval leaves 0 out.
        """
        first = self.planners[0]
        config, result = first.config, first.result
        return {
            "program_version": VERSION,
            "scenario": result.scenario,
            "localization": result.localization,
            "seed": result.seed,
            "episodes": len(result.records),
            "reward": {
                "of": self.reward,
                "reward_scale": config.ppo.reward_scale,
                "reward_limit": config.ppo.reward_limit,
                **config.task.reward.model_dump(mode="json"),
            },
            "discounts": list(self.discounts),
            "planners": [self._planner(each) for each in self.planners],
        }

    def _planner(self, planner: PlannerReturns) -> dict[str, Any]:
        result, metrics = planner.result, planner.result.metrics
        warmth = {} if result.temperature == 1.0 else {"temperature": result.temperature}
        return {
            "planner": result.planner,
            "actions": result.actions,
            **warmth,
            "config_hash": result.config_hash,
            **{name: getattr(metrics, name).to_dict() for name in RATES},
            "steps": steps_of(planner).to_dict(),
            "limited_steps": limited_share(planner),
            "discounted": self._discounted(planner),
            "episodes": [
                {
                    "episode": episode_of(record.world),
                    "outcome": record.outcome,
                    "steps": record.steps,
                    "returns": returns.tolist(),
                }
                for record, returns in zip(result.records, planner.returns, strict=True)
            ],
        }

    def _discounted(self, planner: PlannerReturns) -> list[dict[str, Any]]:
        differences: Sequence[Estimate | None]
        differences = self.differences(planner) or [None] * len(self.discounts)
        rows = zip(self.discounts, planner.estimates, mean_parts(planner), differences, strict=True)
        return [
            {
                "discount": discount,
                "return": estimate.to_dict(),
                "parts": parts,
                **(
                    {}
                    if difference is None
                    else {"difference": {**difference.to_dict(), "clear": difference.clear}}
                ),
            }
            for discount, estimate, parts, difference in rows
        ]


def mean_parts(planner: PlannerReturns) -> list[dict[str, float]]:
    """What each part of the reward adds to the mean return, per discount."""
    means = np.mean(planner.sums, axis=0)
    return [dict(zip(planner.parts, row.tolist(), strict=True)) for row in means]


def steps_of(planner: PlannerReturns) -> Estimate:
    """Control steps of an episode."""
    return Estimate.of(record.steps for record in planner.result.records)


def limited_share(planner: PlannerReturns) -> float:
    """Share of control steps whose reward a limit cut."""
    return planner.limited / sum(record.steps for record in planner.result.records)
