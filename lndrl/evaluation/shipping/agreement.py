"""Whether two sets of weights of one network decide alike: in half precision and as they were."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from lndrl.config import RunConfig
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.navigation import EpisodeRecord, Navigation, Observation
from lndrl.planners import PlannerSource
from lndrl.policy import PolicyRunner, driven_at
from lndrl.randomness import Stream

BATCH = 64
"""Observations that are evaluated at once; the same for both, so that rounding is the same."""
LIKELY = 0.01
"""Probability from which an action matters; below, a difference of logarithms says little."""
MOST_CHANGED = 0.01
"""Share of decisions, greedy and sampled, that may be others."""
LEAST_P = 0.01
"""Of the paired test of arrivals; below it they differ by more than chance."""


@dataclass(frozen=True)
class Agreement:
    """How two policies agree on ``observations`` that one of them met, and in ``episodes``.

    ``greatest``: largest difference of log-probabilities, ``greatest_likely`` among actions of
    probability LIKELY or more. ``greedy_changed`` and ``sampled_changed``: share of decisions that
    are others (sampled: with the same noise). ``arrived``: of the first and second, in the same
    episodes; ``other_outcomes``: episodes that ended otherwise; ``p``: that arrivals differ as they
    do by chance (exact, paired).
    """

    observations: int
    greatest: float
    greatest_likely: float
    greedy_changed: float
    sampled_changed: float
    episodes: int
    arrived: tuple[int, int]
    other_outcomes: int
    p: float

    @property
    def complaints(self) -> list[str]:
        """What is beyond noise, in words; empty where nothing is."""
        found = [
            f"{100 * share:.2f} % of {kind} decisions are others (at most {100 * MOST_CHANGED:g} %)"
            for kind, share in (("greedy", self.greedy_changed), ("sampled", self.sampled_changed))
            if share > MOST_CHANGED
        ]
        if self.p < LEAST_P:
            one, two = self.arrived
            found.append(
                f"it arrives in {two} instead of {one} of {self.episodes} episodes (p {self.p:.3g})"
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        """Plain types for JSON."""
        return {**asdict(self), "arrived": list(self.arrived)}


def met(
    source: PlannerSource, configs: Sequence[RunConfig], observations: int,
    progress: Callable[[], None] | None = None,
) -> Observation:  # fmt: skip
    """At least ``observations`` that ``source`` meets, as many in each of ``configs``, (N,)."""
    each = -(-observations // len(configs))
    found: list[Observation] = []
    for config in configs:
        seen: list[Observation] = []

        def watch(world: Navigation, seen: list[Observation] = seen) -> None:
            if world.outcome == "":
                seen.append(world.observation.reshape(1).copy())

        runner = EpisodeRunner(source, config)
        first = 0
        while len(seen) < each:
            for _ in runner(range(first, first + 4), watch):
                pass
            first += 4
        # Evenly from all episodes: the first steps of many are much the same.
        found += [seen[k * len(seen) // each] for k in range(each)]
        if progress is not None:
            progress()
    return Observation.concatenate(found)


def compare(
    config: RunConfig,
    first: bytes,
    second: bytes,
    seen: Observation,
    records: tuple[Sequence[EpisodeRecord], Sequence[EpisodeRecord]],
) -> Agreement:
    """How weights ``first`` and ``second`` of ``config`` agree on observations ``seen`` (N,).

    ``records``: of the same episodes in the same order, driven with each. Decisions are drawn at
    the temperature that ``second`` is meant to be sampled at. Raises UserError where weights do not
    fit.
    """
    one, two = (_log_probabilities(config, blob, seen) for blob in (first, second))
    difference = np.abs(one - two)
    likely = np.maximum(one, two) >= np.log(LIKELY)
    noise = np.random.default_rng([config.seed, int(Stream.POLICY)]).gumbel(size=one.shape)
    temperature = driven_at(second)
    drawn = [(each / temperature + noise).argmax(axis=1) for each in (one, two)]
    outcomes = [outcomes_of(each) for each in records]
    arrived = [[outcome == "arrived" for outcome in each] for each in outcomes]
    pairs = list(zip(*arrived, strict=True))
    gained, missed = pairs.count((False, True)), pairs.count((True, False))
    changed = gained + missed
    return Agreement(
        observations=len(seen),
        greatest=float(difference.max()),
        greatest_likely=float(difference[likely].max()),
        greedy_changed=float((one.argmax(axis=1) != two.argmax(axis=1)).mean()),
        sampled_changed=float((drawn[0] != drawn[1]).mean()),
        episodes=len(pairs),
        arrived=(sum(arrived[0]), sum(arrived[1])),
        other_outcomes=sum(a != b for a, b in zip(*outcomes, strict=True)),
        p=float(binomtest(gained, changed).pvalue) if changed else 1.0,
    )


def outcomes_of(records: Sequence[EpisodeRecord]) -> list[str]:
    """How each episode ended."""
    return [record.outcome for record in records]


def _log_probabilities(config: RunConfig, blob: bytes, seen: Observation) -> NDArray[np.float64]:
    runner = PolicyRunner(config)
    runner.load(blob)
    parts = [
        runner.log_probabilities(seen.take(slice(first, first + BATCH)))
        for first in range(0, len(seen), BATCH)
    ]
    return np.concatenate(parts).astype(np.float64)
