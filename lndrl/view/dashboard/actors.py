"""The table of actors: in which order, which of them, and as many as there is room for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rich.text import Text

from lndrl.numbering import by_number
from lndrl.transport.status import ACTOR_ACTIVITIES, ActorStatus, Status
from lndrl.view.dashboard.panels import PART_COLOURS, Panel
from lndrl.view.dashboard.view import View
from lndrl.view.palette import BAD, WARNING
from lndrl.view.text import (
    BLOCKS,
    MISSING,
    duration,
    fit,
    named_shares,
    number,
    printable,
    stacked_bar,
    styled,
)

RANK = {"gone": 0, "slow": 1, "active": 2}
PALE_AFTER = 60.0
"""s that an actor which is gone stands out; then it is drawn pale."""
LAST_AFTER = 300.0
"""s after which one that is gone stands last, behind those that work."""
LEFT_OUT_AFTER = 1800.0
"""s after which one that is gone is only counted."""


def gone_for(actor: ActorStatus) -> float | None:
    """s since the actor has gone, None while it is here; older learners tell less exactly."""
    if actor.state != "gone":
        return None
    known = actor.gone_for if actor.gone_for is not None else actor.last_ack_age
    return known or 0.0


def worst_first(actors: Sequence[ActorStatus]) -> list[ActorStatus]:
    """Gone before slow before active; within these, silent and lagging ones first.

    Who has been gone for long stands last. Ages count in steps of 5 s so that rows do not swap
    places at every redraw.
    """
    return sorted(
        actors,
        key=lambda a: (
            (gone_for(a) or 0.0) > LAST_AFTER,
            RANK.get(a.state, 1),
            -math.floor((a.last_ack_age or 0.0) / 5.0),
            -(a.lag // 2),
            by_number(a.id),
        ),
    )


_BY: dict[str, Callable[[ActorStatus], object]] = {
    "name": lambda a: by_number(a.id),
    "host": lambda a: (a.host, by_number(a.id)),
    "rate": lambda a: (a.rate, by_number(a.id)),
    "lag": lambda a: (-a.lag, by_number(a.id)),
    "steps": lambda a: (a.steps, by_number(a.id)),
}
_TITLE_OF = {"name": "actor", "host": "host", "rate": "steps/s", "lag": "lag", "steps": "steps"}


def ordered(actors: Sequence[ActorStatus], order: str) -> list[ActorStatus]:
    """Worst first, or by name or host; by rate or steps, the lowest first; by lag, the highest."""
    by = _BY.get(order)
    return worst_first(actors) if by is None else sorted(actors, key=by)  # type: ignore[arg-type]


def matching(actors: Sequence[ActorStatus], needle: str) -> list[ActorStatus]:
    """Those whose name, host or state has all words of ``needle``, whatever their case.

    Without a needle, all but those that have been gone for very long.
    """
    words = needle.lower().split()
    if not words:
        return [actor for actor in actors if (gone_for(actor) or 0.0) <= LEFT_OUT_AFTER]
    return [
        actor
        for actor in actors
        if all(word in f"{actor.id} {actor.host} {actor.state}".lower() for word in words)
    ]


def first_here(actors: Sequence[ActorStatus]) -> ActorStatus | None:
    """The first that is not gone, if any."""
    return next((actor for actor in actors if actor.state != "gone"), None)


@dataclass(frozen=True)
class _Column:
    title: str
    width: int
    value: Callable[[ActorStatus], str]
    priority: int
    """Columns of the highest number are the first to go on a narrow terminal."""
    left: bool = False


COLUMNS = (
    _Column("actor", 14, lambda a: a.id, 0, left=True),
    _Column("host", 14, lambda a: a.host, 5, left=True),
    _Column("state", 6, lambda a: a.state, 0, left=True),
    _Column("worlds", 6, lambda a: str(a.worlds), 4),
    _Column("steps/s", 7, lambda a: number(a.rate), 1),
    _Column("lag", 4, lambda a: str(a.lag), 1),
    _Column("last ack", 10, lambda a: duration(a.last_ack_age), 1),
    _Column("restarts", 8, lambda a: str(a.restarts), 3),
    _Column("steps", 9, lambda a: f"{a.steps:,}", 6),
)
SPLIT_ROOM = 20


def actors(status: Status, width: int, rows: int, view: View | None = None) -> Panel:
    """At most ``rows`` lines: a heading, the actors of ``view``, and how many there are beside.

    ``Panel.shown`` is how many actors are drawn.
    """
    view = view or View()
    states = sorted((actor.state for actor in status.actors), key=lambda s: -RANK.get(s, 1))
    counts = [f"{states.count(state)} {state}" for state in dict.fromkeys(states)]
    note = ", ".join(counts)
    if view.needle:
        note = f"with “{printable(view.needle)}” of {note}"
    if view.order != "worst":
        note = f"by {_TITLE_OF[view.order]} · {note}"
    if not status.actors:
        return Panel("actors", [fit(styled("none has joined", "dim"), width)], note)
    listed = ordered(matching(status.actors, view.needle), view.order)
    columns = _columns(width)
    used = sum(column.width + 2 for column in columns)
    split = width - used if width - used >= SPLIT_ROOM else 0
    lines = [_heading(columns, split, _TITLE_OF.get(view.order, ""))]
    left_out = len(status.actors) - len(listed)
    crowded = len(listed) + (left_out > 0) > rows - 1
    room = max(rows - 2, 0) if crowded else len(listed)
    first = min(view.scroll, max(len(listed) - room, 0))
    shown = listed[first : first + room]
    lines.extend(_row(actor, columns, split) for actor in shown)
    words = _rest(listed[:first], listed[first + room :], left_out, view.needle)
    if words:
        lines.append(styled(words, "dim"))
    lines = [fit(line, width) for line in lines[: max(rows, 1)]]
    return Panel("actors", lines, note, shown=len(shown))


def _rest(
    above: Sequence[ActorStatus], below: Sequence[ActorStatus], left_out: int, needle: str
) -> str:
    """What is not shown, in words."""
    parts = [f"{len(above)} above"] if above else []
    if below:
        kinds = ", ".join(dict.fromkeys(actor.state for actor in below))
        parts.append(f"+{len(below)} more ({kinds})")
    if left_out:
        why = "without these words" if needle else "gone for long"
        parts.append(f"{left_out} {why}")
    return " · ".join(parts)


def _columns(width: int) -> list[_Column]:
    columns = list(COLUMNS)
    while sum(column.width + 2 for column in columns) > width + 2:
        last = max(columns, key=lambda column: column.priority)
        if last.priority == 0:
            break
        columns.remove(last)
    spare = width + 2 - sum(column.width + 2 for column in columns)
    if 0 < spare < SPLIT_ROOM + 2:
        columns[0] = replace(columns[0], width=columns[0].width + spare)
    return columns


def _heading(columns: Sequence[_Column], split: int, by: str) -> Text:
    line = Text(no_wrap=True)
    for i, c in enumerate(columns):
        words = f"{c.title:<{c.width}}" if c.left else f"{c.title:>{c.width}}"
        line.append("  " if i else "").append(words, style="bold" if c.title == by else "dim")
    if split:
        line.append("  ")
        names = [name if split >= 46 else name[:3] for name in ACTOR_ACTIVITIES]
        for i, name in enumerate(names):
            if sum(len(word) + 2 for word in names[: i + 1]) <= split:
                line.append(f"{BLOCKS[i]}", style=PART_COLOURS[i])
                line.append(f"{name} ", style="dim")
    return line


def _row(actor: ActorStatus, columns: Sequence[_Column], split: int) -> Text:
    line = Text(no_wrap=True)
    gone = gone_for(actor)
    pale = gone is not None and gone > PALE_AFTER
    colour = {"gone": BAD, "slow": WARNING}.get(actor.state, "default")
    if pale:
        colour = "dim" if gone is not None and gone > LAST_AFTER else f"dim {BAD}"
    for i, column in enumerate(columns):
        cell = Text(printable(column.value(actor)))
        if column.left:
            cell.truncate(column.width, overflow="ellipsis", pad=True)
        else:
            cell.align("right", column.width)
        told = column.title in ("actor", "state", "last ack")
        cell.stylize(colour if told else "dim" if pale else "default")
        line.append("  " if i else "").append_text(cell)
    shares = named_shares(actor.time_split, ACTOR_ACTIVITIES)
    if split and shares and not pale:
        parts = [(s, PART_COLOURS[i % len(PART_COLOURS)]) for i, (_, s) in enumerate(shares)]
        line.append("  ").append_text(stacked_bar(parts, split))
    elif split:
        line.append(f"  {MISSING}", style="dim")
    return line
