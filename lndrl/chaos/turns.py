"""Floods and calms in turns, and what a learner achieved and spent in each of them.

A shared machine changes its speed within minutes, so every flood is held against the calms beside
it; and what a learner did is read at its updates, as half an update says nothing.
"""

from __future__ import annotations

import bisect
import random
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

CALM, FLOOD = (5.0, 7.0), (10.0, 14.0)
"""s that a turn lasts, least and most: drawn, so that nothing periodic falls into step."""

SETTLING = 1.0
"""s at the beginning of a turn that do not count: what was sent before is still answered."""


@dataclass(frozen=True)
class Mark:
    """The learner at one of its updates: monotonic s, samples trained and CPU s, both in all."""

    time: float
    samples: int
    cpu: float


@dataclass(frozen=True)
class Flood:
    """One flood: monotonic s, and the messages sent in it."""

    begin: float
    end: float
    messages: int

    @property
    def rate(self) -> float:
        """Messages per second."""
        return self.messages / max(self.end - self.begin, 1e-9)


@dataclass(frozen=True)
class Reading:
    """What happened between two updates."""

    seconds: float
    samples: int
    cpu: float

    @property
    def rate(self) -> float:
        """Samples trained per second."""
        return self.samples / self.seconds

    @property
    def cpu_per_sample(self) -> float:
        """CPU s of the learner for each sample trained."""
        return self.cpu / self.samples


@dataclass(frozen=True)
class Cost:
    """What floods cost the learner; None where there was nothing to compare.

    ``calm``, ``flood``: samples trained per s, medians over turns. ``ratio``: flood over calm, the
    median over neighbouring turns, of which ``least`` and ``most`` are the extremes.
    ``ms_per_message``: CPU ms of the learner beyond what its training takes in the calms beside,
    per message, the median over floods.
    """

    calm: float | None = None
    flood: float | None = None
    ratio: float | None = None
    least: float | None = None
    most: float | None = None
    ms_per_message: float | None = None


def durations(seed: int, calm: tuple[float, float] = CALM) -> Iterator[tuple[float, float]]:
    """Endless pairs of the s of a calm, of least and most ``calm``, and of the flood after it."""
    draw = random.Random(f"turns {seed}")
    while True:
        yield draw.uniform(*calm), draw.uniform(*FLOOD)


def read(marks: Sequence[Mark], begin: float, end: float) -> Reading | None:
    """From the first to the last update of a turn, once it has settled; None without two."""
    first = bisect.bisect_left(marks, begin + SETTLING, key=lambda mark: mark.time)
    last = bisect.bisect_right(marks, end, key=lambda mark: mark.time) - 1
    if last <= first:
        return None
    one, other = marks[first], marks[last]
    return Reading(other.time - one.time, other.samples - one.samples, other.cpu - one.cpu)


def cost(marks: Sequence[Mark], floods: Sequence[Flood], begin: float, end: float) -> Cost:
    """What ``floods`` cost; between ``begin`` and ``end`` all else was calm."""
    ends = [begin, *(flood.end for flood in floods)]
    begins = [*(flood.begin for flood in floods), end]
    calms = [read(marks, *gap) for gap in zip(ends, begins, strict=True)]
    wild = [read(marks, flood.begin, flood.end) for flood in floods]
    ratios, extra = [], []
    for number, (flood, reading) in enumerate(zip(floods, wild, strict=True)):
        beside = [calm for calm in calms[number : number + 2] if calm is not None]
        if reading is None or not beside:
            continue
        ratios += [reading.rate / calm.rate for calm in beside]
        usual = statistics.mean(calm.cpu_per_sample for calm in beside)
        messages = flood.rate * reading.seconds
        extra.append(1e3 * (reading.cpu - usual * reading.samples) / max(messages, 1.0))
    return Cost(
        calm=_median([calm.rate for calm in calms if calm is not None]),
        flood=_median([reading.rate for reading in wild if reading is not None]),
        ratio=_median(ratios),
        least=min(ratios, default=None),
        most=max(ratios, default=None),
        ms_per_message=_median(extra),
    )


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None
