"""What a fleet bench shall measure, from the command line."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lndrl.config import MOST_ACTORS
from lndrl.errors import UserError

RATE = 300.0
"""Control steps per second that every synthetic actor offers: a real one of one fast core."""
MOST_ACTORS_PLAYED = MOST_ACTORS
UPDATES = ("drain", "real")
CONGESTION = ("bbr", "cubic", "reno")


@dataclass(frozen=True)
class LinkPlan:
    """A long wire between actors and learner: ``round_trip`` in s, ``loss`` each way as a share of
    packets, and by which ``congestion`` control both ends send.
    """

    round_trip: float
    loss: float
    congestion: str = "bbr"


@dataclass(frozen=True)
class Plan:
    """``actors``: a row for each number. ``update`` drain: batches are counted as trained, and the
    networks stay as they are; real: the learner learns. ``every``: s between two chunks of an
    actor, None for as many as make RATE. ``seconds``: timed s of a row, at least. ``link``: between
    learner and actors, in namespaces of their own; None for none. ``site``: actors come through a
    site's door. ``model``: measure first what a chunk costs, and predict the rows from it.
    """

    actors: tuple[int, ...]
    update: str = "drain"
    every: float | None = None
    seconds: float = 10.0
    link: LinkPlan | None = None
    site: bool = False
    model: bool = False

    def period(self, samples: int) -> float:
        """s between two chunks of ``samples`` control steps that an actor offers."""
        return samples / RATE if self.every is None else self.every

    def span(self, samples: int) -> float:
        """Timed s: whole periods, at least two, so that every actor sends as often as it should."""
        period = self.period(samples)
        return max(2, math.ceil(self.seconds / period)) * period


def plan_of(
    actors: str,
    update: str = "drain",
    every: float | None = None,
    seconds: float = 10.0,
    link: str | None = None,
    congestion: str = "bbr",
    site: bool = False,
) -> Plan:
    """A plan from what the command line says; raises UserError with one sentence."""
    numbers = []
    for word in actors.split(","):
        number = int(word) if word.strip().isdecimal() else 0
        if not 1 <= number <= MOST_ACTORS_PLAYED:
            raise UserError(
                f"--actors {actors}: {word.strip() or 'nothing'!r} is not a number of actors from"
                f" 1 to {MOST_ACTORS_PLAYED}; write them like 1,8,64"
            )
        numbers.append(number)
    if update not in UPDATES:
        raise UserError(f"--update {update}: must be {' or '.join(UPDATES)}")
    if every is not None and not every > 0:
        raise UserError(f"--every {every:g}: must be above 0")
    far = _link_of(link, congestion)
    # The model is of the door: what an optimizer takes and what a wire carries are other limits.
    near = update == "drain" and far is None and not site
    return Plan(tuple(numbers), update, every, seconds, far, site, model=near)


def _link_of(link: str | None, congestion: str) -> LinkPlan | None:
    if congestion not in CONGESTION:
        raise UserError(f"--congestion {congestion}: must be one of {', '.join(CONGESTION)}")
    if link is None:
        return None
    try:
        milliseconds, loss = map(float, link.split(","))
    except ValueError:
        milliseconds = loss = -1.0
    if not (0.0 <= milliseconds <= 10_000.0 and 0.0 <= loss < 1.0):
        raise UserError(
            f"--link {link}: must be the round trip in milliseconds and the share of packets that"
            " is lost each way, e.g. 100,0.01"
        )
    return LinkPlan(milliseconds / 1e3, loss, congestion)
