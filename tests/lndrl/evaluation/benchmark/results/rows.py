"""Rows of the bench that are made of outcomes alone."""

from __future__ import annotations

from lndrl.evaluation.benchmark import Row
from lndrl.evaluation.benchmark.store import COLUMNS
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.families import Family
from lndrl.navigation.reward import REWARD_PARTS

OUTCOMES = {"a": "arrived", "c": "collided", "l": "lost", "t": "timeout"}


def record(letter: str, k: int = 0) -> EpisodeRecord:
    """Episode ``k`` of the bench; ``letter`` is the first of how it ends."""
    return EpisodeRecord.from_dict(
        {
            "world": Family.BENCH.world(k),
            "episode": 0,
            "outcome": OUTCOMES[letter],
            "steps": 50,
            **dict.fromkeys(COLUMNS[3:9], 10.0),
            "reward_parts": dict.fromkeys(REWARD_PARTS, 0.0),
        }
    )


_RECORDS = {letter: record(letter) for letter in OUTCOMES}


def row(method: str, outcomes: str, scenario: str = "sparse") -> Row:
    """A row whose episode k ends as the k-th letter of ``outcomes`` says."""
    records = {(scenario, k): _RECORDS[letter] for k, letter in enumerate(outcomes)}
    return Row(method, (scenario,), records)


def share(arrived: int, lost: int = 0, collided: int = 0, episodes: int = 2000) -> str:
    """Outcomes of so many episodes, the rest out of time."""
    rest = episodes - arrived - lost - collided
    return "a" * arrived + "l" * lost + "c" * collided + "t" * rest
