"""The paper's nine metrics of a planner, from the records of its episodes (PAPER §IV-B)."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import OUTCOMES
from lndrl.wilson import NORMAL_QUANTILE_95, wilson_interval


@dataclass(frozen=True)
class Rate:
    """Share of episodes with one outcome, with its Wilson 95 % interval."""

    count: int
    episodes: int

    @property
    def value(self) -> float:
        """Rate in [0, 1]; 0 without episodes."""
        return self.count / self.episodes if self.episodes else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson 95 % interval ``(low, high)``."""
        return wilson_interval(self.count, self.episodes)

    def to_dict(self) -> dict[str, Any]:
        """Plain types: rate, interval, count."""
        return {"rate": self.value, "interval": list(self.interval), "count": self.count}


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation (of the population, like ``numpy.std``) over episodes.

    Both are None when no episode counts, e.g. the reach time of a planner that never arrives.
    """

    mean: float | None
    deviation: float | None
    episodes: int

    @classmethod
    def of(cls, values: Iterable[float]) -> Spread:
        """Spread of one value per episode."""
        data = [float(value) for value in values]
        if not data:
            return cls(None, None, 0)
        mean = statistics.fmean(data)
        return cls(mean, statistics.pstdev(data, mean), len(data))

    @property
    def interval(self) -> tuple[float, float] | None:
        """Normal 95 % interval ``(low, high)`` of the mean; None below two episodes."""
        if self.mean is None or self.deviation is None or self.episodes < 2:
            return None
        # The population's deviation over the root of n - 1 is the sample's over that of n.
        half = NORMAL_QUANTILE_95 * self.deviation / math.sqrt(self.episodes - 1)
        return self.mean - half, self.mean + half

    def to_dict(self) -> dict[str, Any]:
        """Plain types: mean, deviation, number of episodes that count."""
        return {"mean": self.mean, "deviation": self.deviation, "episodes": self.episodes}


@dataclass(frozen=True)
class Metrics:
    """The nine metrics of Table II, plus the mean return.

    Reach time (s) and moving distance (m) count arrived episodes only, as the paper defines
    them; position error (m), angle error (rad) and the sum of variances (m², rad²) are means
    over the steps of each episode, and all episodes count once whatever their length.
    """

    arrival: Rate
    collision: Rate
    lost: Rate
    stuck: Rate
    reach_time: Spread
    distance: Spread
    position_error: Spread
    angle_error: Spread
    variance_sum: Spread
    episode_return: Spread

    def to_dict(self) -> dict[str, Any]:
        """Plain types under the field names."""
        return {name: getattr(self, name).to_dict() for name in self.__dataclass_fields__}


def metrics_of(records: Sequence[EpisodeRecord]) -> Metrics:
    """Metrics of a planner from its finished episodes.

    Raises ValueError for an outcome that is not one of ``OUTCOMES``: the rates sum to 1.
    """
    counts = dict.fromkeys(OUTCOMES, 0)
    for record in records:
        if record.outcome not in counts:
            raise ValueError(f"outcome {record.outcome!r} is none of {', '.join(OUTCOMES)}")
        counts[record.outcome] += 1
    arrived = [record for record in records if record.outcome == "arrived"]
    return Metrics(
        arrival=Rate(counts["arrived"], len(records)),
        collision=Rate(counts["collided"], len(records)),
        lost=Rate(counts["lost"], len(records)),
        stuck=Rate(counts["timeout"], len(records)),
        reach_time=Spread.of(record.time for record in arrived),
        distance=Spread.of(record.distance for record in arrived),
        position_error=Spread.of(record.position_error for record in records),
        angle_error=Spread.of(record.angle_error for record in records),
        variance_sum=Spread.of(record.variance_sum for record in records),
        episode_return=Spread.of(record.episode_return for record in records),
    )
