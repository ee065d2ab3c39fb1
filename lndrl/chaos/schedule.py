"""Which fault strikes what, when and for how long: a pure function of a seed.

Kinds are dealt like cards from a shuffled deck that holds each as often as its ``share``, so every
kind comes once per deck. Faults of one lane never overlap; what strikes different lanes may.
"""

from __future__ import annotations

import random
from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

LEARNER = "learner"
"""The lane of everything that all actors feel: one such fault at a time, or none is measured."""

GUARD = 15.0
"""s after a fault of the learner's lane before the next: as long as a recovery may take."""


@dataclass(frozen=True)
class Kind:
    """A kind of fault: cards per deck, shortest and longest duration (s), the lane it takes.

    ``actor``: the lane of the actor it strikes, else the learner's or one of its own ("").
    ``least`` is the length (min) of the shortest schedule it belongs in.
    """

    name: str
    share: int
    durations: tuple[float, float]
    lane: str
    least: float = 0.0


KINDS = {
    kind.name: kind
    for kind in (
        Kind("actor_kill", 5, (0.0, 0.0), "actor"),
        Kind("actor_freeze", 4, (7.0, 12.0), "actor"),
        Kind("fleet_kill", 1, (0.0, 0.0), "actor"),
        Kind("proxy_delay", 3, (5.0, 15.0), "actor"),
        Kind("proxy_cut", 3, (0.5, 6.0), "actor"),
        Kind("proxy_stall", 3, (2.0, 12.0), "actor"),
        Kind("old_weights", 1, (20.0, 40.0), "", 2.0),
        Kind("dashboard_freeze", 1, (5.0, 15.0), "", 1.0),
        Kind("second_run", 1, (60.0, 90.0), "", 4.0),
        Kind("router_restart", 2, (1.0, 5.0), LEARNER),
        Kind("learner_kill", 2, (0.0, 0.0), LEARNER),
        Kind("learner_freeze", 2, (1.0, 3.0), LEARNER),
        Kind("learner_stall", 1, (14.0, 18.0), LEARNER, 1.0),
        Kind("disk_full", 1, (5.0, 10.0), LEARNER, 1.0),
        Kind("read_only", 1, (5.0, 10.0), LEARNER, 1.0),
        Kind("join_storm", 1, (20.0, 20.0), LEARNER, 2.0),
    )
}


@dataclass(frozen=True)
class Fault:
    """One fault. ``time``: s from the start of the chaos; ``duration``: s until it is mended."""

    time: float
    kind: str
    target: str
    duration: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


def schedule(
    seed: int,
    minutes: float,
    actors: int = 2,
    pace: float = 12.0,
    kinds: Collection[str] | None = None,
) -> list[Fault]:
    """Faults in order of time, one every ``pace`` s on average; each is mended before the end.

    ``kinds`` (all by default) are the ones to choose from. Raises ValueError for an unknown kind.
    """
    chosen = set(KINDS if kinds is None else kinds)
    if unknown := chosen - set(KINDS):
        raise ValueError(f"unknown fault {sorted(unknown)[0]}; known: {', '.join(KINDS)}")
    cards = [
        name
        for name, kind in KINDS.items()
        if name in chosen and kind.least <= minutes
        for _ in range(kind.share)
    ]
    end = 60.0 * minutes
    draw = random.Random(f"chaos {seed}")
    busy: dict[str, float] = {}
    faults: list[Fault] = []
    deck: list[str] = []
    now = draw.uniform(0.2, 1.0) * pace
    while now < end and cards:
        if not deck:
            deck = draw.sample(cards, len(cards))
        fault = _deal(deck, draw, now, end, actors, busy)
        if fault is not None:
            faults.append(fault)
            deck.remove(fault.kind)
        now += draw.uniform(0.5, 1.5) * pace
    return faults


def _deal(
    deck: list[str],
    draw: random.Random,
    now: float,
    end: float,
    actors: int,
    busy: dict[str, float],
) -> Fault | None:
    """The first card that has a free lane and still ends in time; notes how long it takes that."""
    for name in deck:
        kind = KINDS[name]
        places = [f"actor-{i}" for i in range(actors)] if kind.lane == "actor" else [name]
        if kind.lane == LEARNER:
            places = [LEARNER]
        target = draw.choice(places)
        duration = round(draw.uniform(*kind.durations), 2)
        if busy.get(target, 0.0) > now or now + duration > end:
            continue
        guard = GUARD if kind.lane == LEARNER else 3.0
        busy[target] = now + duration + guard
        return Fault(round(now, 2), name, target, duration)
    return None
