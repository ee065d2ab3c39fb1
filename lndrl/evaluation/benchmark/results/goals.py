"""What the method has to reach beside the paper's table, in one list, and whether it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from lndrl.evaluation.benchmark.figures import Row
from lndrl.evaluation.benchmark.results.paired import Difference

Rows = Mapping[str, Row]

ARRIVAL = Fraction("0.95")
COLLISION = Fraction("0.03")
LOST = Fraction("0.005")
LOST_SHARE = Fraction(1, 4)
ARRIVAL_RATIO = Fraction("1.4")
MINDFUL = "careful"
CLASSICAL = "dwa"
LEARNED = ("drl_laser", "drl_laser_ped")


@dataclass(frozen=True)
class Verdict:
    """What was seen of a goal; ``met`` is None while a row that decides it is not there yet."""

    goal: str
    seen: str
    met: bool | None

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        words = {True: "met", False: "not met", None: "not there yet"}[self.met]
        return {"goal": self.goal, "seen": self.seen, "verdict": words}


@dataclass(frozen=True)
class Goal:
    """``judge`` takes the row that has to reach it and all rows; returns ``seen`` and ``met``."""

    words: str
    judge: Callable[[Row, Rows], tuple[str, bool | None]]


def verdicts(method: str, rows: Rows) -> list[Verdict]:
    """Every goal held against the row ``method`` of ``rows``, which need not be there."""
    row = rows.get(method)
    found = []
    for goal in GOALS:
        seen, met = ("", None) if row is None else goal.judge(row, rows)
        found.append(Verdict(goal.words, seen, met))
    return found


def rate(row: Row, outcome: str) -> Fraction:
    """Share of the episodes of ``row`` that ended so; exact, for goals are met at their border."""
    count = sum(record.outcome == outcome for record in row.records.values())
    return Fraction(count, max(len(row.records), 1))


def _arrival(row: Row, rows: Rows) -> tuple[str, bool | None]:
    arrived = rate(row, "arrived")
    return f"{float(arrived):.4f}", arrived >= ARRIVAL


def _collision(row: Row, rows: Rows) -> tuple[str, bool | None]:
    collided = rate(row, "collided")
    return f"{float(collided):.4f}", collided <= COLLISION


def _lost(row: Row, rows: Rows) -> tuple[str, bool | None]:
    lost, mindful = rate(row, "lost"), rows.get(MINDFUL)
    if mindful is None:
        # Its own rate can only raise the limit.
        return _beside(lost, "lost", rows, (MINDFUL,)), True if lost <= LOST else None
    return _beside(lost, "lost", rows, (MINDFUL,)), lost <= max(LOST, rate(mindful, "lost"))


def _lost_share(row: Row, rows: Rows) -> tuple[str, bool | None]:
    names = (CLASSICAL, *LEARNED)
    lost = rate(row, "lost")
    seen = _beside(lost, "lost", rows, names)
    there = [rate(rows[name], "lost") for name in names if name in rows]
    if there and lost > LOST_SHARE * min(there):
        return seen, False  # rows that come can only lower the lowest
    return seen, True if len(there) == len(names) else None


def _arrival_ratio(row: Row, rows: Rows) -> tuple[str, bool | None]:
    arrived = rate(row, "arrived")
    seen = _beside(arrived, "arrived", rows, (CLASSICAL,))
    if CLASSICAL not in rows:
        return seen, None
    return seen, arrived >= ARRIVAL_RATIO * rate(rows[CLASSICAL], "arrived")


def _above_learned(row: Row, rows: Rows) -> tuple[str, bool | None]:
    there = [rows[name] for name in LEARNED if name in rows]
    seen = _beside(rate(row, "arrived"), "arrived", rows, LEARNED)
    if len(there) < len(LEARNED):
        return seen, None
    highest = max(rate(other, "arrived") for other in there)
    tied = [other for other in there if rate(other, "arrived") == highest]
    low, high = min(Difference.of(row, other, "arrived").interval for other in tied)
    return f"{seen}; {100 * low:+.1f} to {100 * high:+.1f} points", low > 0


def _beside(own: Fraction, outcome: str, rows: Rows, names: tuple[str, ...]) -> str:
    """``own`` rate and those of the rows ``names`` that are there."""
    others = [
        f"{name} {float(rate(rows[name], outcome)):.4f}" if name in rows else f"no {name} yet"
        for name in names
    ]
    return "; ".join([f"{float(own):.4f}", *others])


GOALS = (
    Goal(f"arrived in at least {float(ARRIVAL)}", _arrival),
    Goal(f"collided in at most {float(COLLISION)}", _collision),
    Goal(f"lost in at most {float(LOST)}, or in no more than {MINDFUL} is", _lost),
    Goal(
        f"lost at most {LOST_SHARE} as often as the best of {', '.join((CLASSICAL, *LEARNED))}",
        _lost_share,
    ),
    Goal(f"arrived at least {float(ARRIVAL_RATIO)} times as often as {CLASSICAL}", _arrival_ratio),
    Goal(
        f"arrived more often than the better of {' and '.join(LEARNED)}, "
        "paired 95 % interval without 0",
        _above_learned,
    ),
)
"""Of shares of all episodes of the bench."""
