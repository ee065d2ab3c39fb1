"""How often one gets lost per control step: unlike a rate of episodes, it forgives nobody who
collides early."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lndrl.evaluation.wilson import wilson_interval
from lndrl.navigation import EpisodeRecord

STEPS = 1000
"""A hazard is per so many control steps."""


@dataclass(frozen=True)
class Hazard:
    """``count`` episodes ended lost in ``steps`` control steps."""

    count: int
    steps: int

    @classmethod
    def of(cls, records: Sequence[EpisodeRecord]) -> Hazard:
        """Over all steps of ``records``."""
        lost = sum(record.outcome == "lost" for record in records)
        return cls(lost, sum(record.steps for record in records))

    @property
    def value(self) -> float:
        """Lost per 1,000 control steps; 0 without steps."""
        return STEPS * self.count / self.steps if self.steps else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson 95 % interval ``(low, high)``: a step ends an episode lost, or it does not."""
        low, high = wilson_interval(self.count, self.steps)
        return STEPS * low, STEPS * high
