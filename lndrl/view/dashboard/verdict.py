"""How a run is doing, in words first: one word with a colour, and one sentence why."""

from __future__ import annotations

from dataclasses import dataclass

from lndrl.transport.status import VERDICTS, Status
from lndrl.view.palette import BAD, GOOD, QUIET, WARNING
from lndrl.view.text import duration, number, percent, printable
from lndrl.wording import counted

STALE_AFTER = 10.0
"""s without news until a run counts as stale; a learner writes about once a second."""

COLOURS = {
    "compiling": QUIET,
    "learning": GOOD,
    "waiting for actors": WARNING,
    "learner-bound": WARNING,
    "actor-bound": WARNING,
    "balanced": GOOD,
    "stale": BAD,
    "done": GOOD,
}
MARKS = {"done": "✔", "stale": "✖", "waiting for actors": "▲"}


@dataclass(frozen=True)
class Headline:
    """``word`` in ``colour`` after ``mark``; ``sentence`` explains it."""

    word: str
    sentence: str
    colour: str
    mark: str


def headline(status: Status, stale_age: float = 0.0) -> Headline:
    """The verdict on ``status``, which was last renewed ``stale_age`` s ago."""
    word, said = _spoken(status)
    finished = status.state == "done" or word == "done"
    if stale_age > STALE_AFTER and not finished:
        sentence = f"last heard {duration(stale_age)} ago, then {word}; still trying"
        return Headline("stale", sentence, COLOURS["stale"], MARKS["stale"])
    if finished:
        word = "done"
    return Headline(
        word, said or _reason(word, status), COLOURS.get(word, QUIET), MARKS.get(word, "●")
    )


def _spoken(status: Status) -> tuple[str, str]:
    """The learner's own word, and what it may have said after a colon."""
    word, _, said = printable(status.verdict).partition(":")
    word = word.strip()
    for known in VERDICTS:
        if word.lower().replace("_", "-") in (known, known.replace(" ", "-")):
            return known, said.strip()
    if word:
        return word, said.strip()
    by_state = {"waiting": "waiting for actors", "training": "learning"}
    return by_state.get(status.state, status.state), ""


def _reason(word: str, status: Status) -> str:
    active = sum(actor.state != "gone" for actor in status.actors)
    actors = counted(active, "actor")
    rate = f"{number(status.rate.seconds_60 or status.rate.seconds_10)} steps/s"
    wait, rest = status.time_split.get("wait"), status.actor_split.get("wait")
    if word == "learning":
        busy = "" if wait is None else f"; the learner is busy {percent(1 - wait, 0)} of the time"
        return f"{actors} deliver{'s' if active == 1 else ''} {rate}{busy}"
    if word == "balanced" and wait is not None and rest is not None:
        return f"{rate}; learner busy {percent(1 - wait, 0)}, actors {percent(1 - rest, 0)}"
    if word == "waiting for actors":
        if active:
            return f"{actors} joined, but no steps arrive yet"
        return "nobody sends steps; start actors with: lndrl actor --connect ENDPOINT"
    if word == "learner-bound":
        chunks = status.queue.chunks
        waiting = f", {counted(chunks, 'chunk waits', 'chunks wait')}" if chunks else ""
        busy = "always busy" if wait is None else f"busy {percent(1 - wait, 0)} of the time"
        idle = "" if rest is None else f", actors idle {percent(rest, 0)}"
        return f"the learner is {busy}{idle}{waiting}: no more actors needed"
    if word == "actor-bound":
        idle = "" if wait is None else f"waits {percent(wait, 0)} of the time; "
        return f"the learner {idle or 'waits; '}more actors would speed up training"
    if word == "done":
        arrived = status.episodes.arrived
        end = "" if arrived is None else f"; {percent(arrived)} of the last episodes arrived"
        return f"{status.steps:,} steps trained{end}"
    return f"{actors}, {rate}"
