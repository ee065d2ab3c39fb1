"""A mean of few or many values, and how sure it is: Student's interval."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from scipy.special import stdtrit


@dataclass(frozen=True)
class Estimate:
    """Mean and sample deviation of ``count`` values; None where there are too few."""

    count: int
    mean: float | None
    deviation: float | None

    @classmethod
    def of(cls, values: Iterable[float]) -> Estimate:
        """Estimate from independent values: one per seed, or one per episode."""
        data = list(values)
        return cls(
            len(data),
            statistics.fmean(data) if data else None,
            statistics.stdev(data) if len(data) > 1 else None,
        )

    @property
    def interval(self) -> tuple[float, float] | None:
        """Student's 95 % interval of the mean; None below two values."""
        if self.mean is None or self.deviation is None:
            return None
        half = self._student * self.deviation / math.sqrt(self.count)
        return self.mean - half, self.mean + half

    @property
    def apart(self) -> float | None:
        """How far two values more are apart at most, in 95 % of cases; None below two values.

        ``t * sqrt(2) * s`` of the sample deviation ``s`` and Student's ``t``, so it is wide while
        values are few: 18 ``s`` of two, 6 of three.
        """
        return None if self.deviation is None else self._student * math.sqrt(2.0) * self.deviation

    @property
    def _student(self) -> float:
        """Of one degree of freedom less than there are values; two-sided, 95 %."""
        return float(stdtrit(self.count - 1, 0.975))

    @property
    def clear(self) -> bool:
        """Whether the 95 % interval leaves 0 out."""
        interval = self.interval
        return interval is not None and not interval[0] <= 0.0 <= interval[1]

    def to_dict(self) -> dict[str, Any]:
        """Plain types, with the standard error of the mean and the interval."""
        error = None if self.deviation is None else self.deviation / math.sqrt(self.count)
        interval = self.interval
        return {
            **asdict(self),
            "standard_error": error,
            "interval": list(interval) if interval else None,
        }
