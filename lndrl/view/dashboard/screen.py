"""The dashboard as a pure function of the learner's status: panels arranged to fit a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rich.console import Group
from rich.text import Text

from lndrl.transport.status import HistoryRow, Status
from lndrl.view.dashboard import panels, validated
from lndrl.view.dashboard.actors import actors, matching
from lndrl.view.dashboard.machines import line as machines_line
from lndrl.view.dashboard.panels import Panel
from lndrl.view.dashboard.verdict import headline
from lndrl.view.dashboard.view import Extent, View
from lndrl.view.dashboard.zoom import help_panel, zoomed
from lndrl.view.text import MISSING, duration, fit, number, styled

NARROWEST = 40
ROOMY = (78, 32)
"""Columns and rows from which panels get borders instead of a ruled title."""
TWO_COLUMNS = 76
SHORT = (28, 22)
"""Rows from which both sides' time has up to three rows, and from which it has two."""
EVENTS_LISTED = 10
"""Events shown where the height is free (``--once``)."""


@dataclass(frozen=True)
class Picture:
    """Lines of exactly one width, and how much of what scrolls they show."""

    lines: list[Text]
    extent: Extent


def render(
    status: Status,
    history: Sequence[HistoryRow],
    width: int,
    height: int | None = None,
    stale_age: float = 0.0,
    hint: str = "",
) -> Group:
    """The whole dashboard in at most ``width`` columns and ``height`` rows.

    ``height`` None takes what it needs. ``stale_age`` (s) is the time since the status was last
    renewed. ``hint`` (keys) stands beside the events. When rows are short, actors and events
    shrink first, then validation becomes one line, then PPO does, then they go, outcomes last.
    """
    return Group(*draw(status, history, width, height, stale_age, View(), hint).lines)


def draw(
    status: Status,
    history: Sequence[HistoryRow],
    width: int,
    height: int | None,
    stale_age: float,
    view: View,
    hint: str = "",
) -> Picture:
    """What ``render`` draws, as ``view`` has it: a panel in focus or on the whole screen, help."""
    width = max(width, NARROWEST)
    boxed = width >= ROOMY[0] and (height is None or height >= ROOMY[1])
    inside = width - 4 if boxed else width
    splits = 3 if height is None or height >= SHORT[0] else 2 if height >= SHORT[1] else 1
    top = frame(panels.header(status, inside, stale_age, splits), width, boxed)
    if height is not None and (view.zoomed or view.helping):
        lines, shown = _alone(status, history, view, width, height, top, boxed)
        return Picture(lines, _extent(status, view, shown if view.focus == "actors" else 1, shown))
    middle = _middle(status, history, width, boxed, view.focus)
    if height is None:
        rows = (len(status.actors) + 1, EVENTS_LISTED)
        middle += _hosts(status, width)
    else:
        middle = _as_fits(status, history, width, boxed, middle, height - len(top))
        if height >= SHORT[0]:
            middle = [*middle, *_hosts(status, width)]
        left = height - len(top) - sum(map(len, middle)) - 2 * (1 + boxed)
        rows = _share_rows(left, len(status.actors) + 1, len(status.events))
    lines = top + [line for block in middle for line in block]
    shown = 0
    if rows[0] >= 2 or (rows[0] and not status.actors):
        table = actors(status, inside, rows[0], view)
        shown = table.shown
        lines += frame(table, width, boxed, view.focus == "actors")
    log = panels.events(status, inside, rows[1], view.back)
    if rows[1]:
        note = " · ".join(words for words in (log.note, hint) if words)
        if height is not None and boxed:
            spare = height - len(lines) - len(log.lines) - 2
            log.lines.extend(fit(Text(), inside) for _ in range(spare))
        log = Panel(log.title, log.lines, note, log.shown)
        lines += frame(log, width, boxed, view.focus == "events")
    return Picture(lines[:height], _extent(status, view, shown, log.shown))


def _hosts(status: Status, width: int) -> list[list[Text]]:
    """The machines in one line, where anything is known of one."""
    known = status.machine.cores or any(actor.machine.cores for actor in status.actors)
    return [[machines_line(status, width)]] if known else []


def _extent(status: Status, view: View, actor_rows: int, event_rows: int) -> Extent:
    listed = len(matching(status.actors, view.needle))
    return Extent(listed, max(actor_rows, 1), len(status.events), max(event_rows, 1))


def _alone(
    status: Status,
    history: Sequence[HistoryRow],
    view: View,
    width: int,
    height: int,
    top: list[Text],
    boxed: bool,
) -> tuple[list[Text], int]:
    """The header, where there is room, and one panel; and how many of its rows scroll."""
    inside = width - 4 if boxed else width
    if not boxed:  # its title, the verdict and how far it is; where rows are very short, nothing
        top = top[:3] if height >= 12 else []
    rows = max(height - len(top) - (2 if boxed else 1), 1)
    if view.helping:
        panel = help_panel(inside, rows)
    else:
        panel = zoomed(status, history, view, inside, rows)
    panel.lines.extend(fit(Text(), inside) for _ in range(rows - len(panel.lines)))
    return [*top, *frame(panel, width, boxed, not view.helping)][:height], panel.shown


def abreast(pictures: Sequence[list[Text]], width: int) -> list[Text]:
    """Pictures whose lines have ``width`` cells, side by side with a cell between them."""
    if len(pictures) == 1:
        return list(pictures[0])
    blank = fit(Text(), width)
    lines = []
    for row in range(max(map(len, pictures))):
        line = Text(no_wrap=True)
        for i, picture in enumerate(pictures):
            line.append(" " if i else "")
            line.append_text(picture[row] if row < len(picture) else blank)
        lines.append(line)
    return lines


def alone(
    status: Status, width: int, height: int, stale_age: float, panel: Callable[[int, int], Panel]
) -> list[Text]:
    """The header, where there is room, and one panel that ``panel`` makes, told how wide and how
    high it is inside; ``height`` lines in all.
    """
    width = max(width, NARROWEST)
    boxed = width >= ROOMY[0] and height >= ROOMY[1]
    inside = width - 4 if boxed else width
    top = frame(panels.header(status, inside, stale_age, 1), width, boxed)
    if not boxed:
        top = top[:3] if height >= 20 else []
    rows = max(height - len(top) - (2 if boxed else 1), 1)
    return [*top, *frame(panel(inside, rows), width, boxed)][:height]


def _as_fits(
    status: Status,
    history: Sequence[HistoryRow],
    width: int,
    boxed: bool,
    middle: list[list[Text]],
    rows: int,
) -> list[list[Text]]:
    """As much of ``middle`` as ``rows`` leave room for beside actors and events."""
    least = 3 * (1 + boxed) + 2
    choices = [(middle, least)]
    results = [frame(panels.outcomes(status, history, width - 4 * boxed), width, boxed)]
    ppo = [panels.ppo_line(status, width)]
    if status.validation is not None:
        line = [validated.line(status, width)]
        choices = [
            (middle, least + 4),
            ([*middle[:-1], line], least + 1),
            ([*results, line, ppo], least + 1),
            (middle[:-1], least),
        ]
    choices += [([*results, ppo], least), (results, least), ([], rows)]
    return next(each for each, need in choices if rows - sum(map(len, each)) >= need)


def _middle(
    status: Status, history: Sequence[HistoryRow], width: int, boxed: bool, focus: str
) -> list[list[Text]]:
    """Outcomes and PPO as blocks of lines: one block side by side, or two, the first more vital.

    Last comes validation, where the run has any.
    """
    margin = 4 if boxed else 0
    last = []
    if status.validation is not None:
        found = validated.panel(status, width - margin)
        last = [frame(found, width, boxed, focus == "validation")]
    if width < TWO_COLUMNS:
        first = panels.outcomes(status, history, width - margin)
        second = panels.ppo(status, width - margin, columns=3)
        return [
            frame(first, width, boxed, focus == "outcomes"),
            frame(second, width, boxed, focus == "ppo"),
            *last,
        ]
    gap = 1 if boxed else 3
    left = (width - gap) * 11 // 20
    right = width - gap - left
    first = panels.outcomes(status, history, left - margin)
    second = panels.ppo(status, right - margin)
    if not boxed:
        del second.lines[len(first.lines) :]
    rows = max(len(first.lines), len(second.lines))
    for panel, room in ((first, left - margin), (second, right - margin)):
        panel.lines.extend(fit(Text(), room) for _ in range(rows - len(panel.lines)))
    pairs = zip(
        frame(first, left, boxed, focus == "outcomes"),
        frame(second, right, boxed, focus == "ppo"),
        strict=True,
    )
    return [[a.copy().append(" " * gap).append_text(b) for a, b in pairs], *last]


def _share_rows(left: int, actors: int, events: int) -> tuple[int, int]:
    """Rows for the actor table (with heading) and for the log, out of ``left``."""
    if left <= 0:
        return 0, 0
    log = min(max(events, 1), 3, left // 3)
    table = min(actors, left - log)
    return table, left - table


def frame(panel: Panel, width: int, boxed: bool, focused: bool = False) -> list[Text]:
    """The panel's lines between borders, or under a ruled title; marked where it is ``focused``."""
    left, line, right = ("╭─ ", "─", "─╮") if boxed else ("", "─", "")
    rule = "bold" if focused else "dim"
    title = styled(left, rule).append("▸ " if focused else "", style="bold")
    title.append(panel.title, style="bold").append(" ")
    words = f" {panel.note}{' ' if boxed else ''}" if panel.note else ""
    note = styled(words + right, rule)
    room = width - title.cell_len - note.cell_len
    if room < 1:
        note, room = styled(right, rule), width - title.cell_len - len(right)
    title.append(line * max(room, 0), style=rule).append_text(note)
    if not boxed:
        return [fit(title, width), *panel.lines]
    body = [styled("│ ", rule).append_text(row).append(" │", style=rule) for row in panel.lines]
    for row in body:
        row.no_wrap = True
    bottom = styled(f"╰{'─' * (width - 2)}╯", rule)
    return [fit(title, width), *body, bottom]


def plain_line(status: Status, stale_age: float = 0.0) -> str:
    """One update as one line of plain characters, for logs and pipes."""
    verdict = headline(status, stale_age)
    share = 100 * status.steps / status.total_steps if status.total_steps else 0.0
    active = sum(actor.state != "gone" for actor in status.actors)
    episodes = status.episodes
    parts = [
        time.strftime("%H:%M:%S", time.localtime(status.time)),
        verdict.word
        if verdict.word not in ("stale", "compiling")
        else f"{verdict.word}, {verdict.sentence}",
        *([status.phase] if status.phase else []),
        f"steps {status.steps:,}/{status.total_steps:,} ({share:.1f}%)",
        f"{number(status.rate.seconds_60)} steps/s",
        f"eta {duration(status.eta)}",
        f"actors {active}/{len(status.actors)}",
    ]
    for key, word in (
        ("arrived", "arrived"),
        ("collided", "collided"),
        ("lost", "lost"),
        ("timeout", "stuck"),
    ):
        value = getattr(episodes, key)
        if value is not None:
            parts.append(f"{word} {100 * value:.1f}%")
    if episodes.mean_return is not None:
        parts.append(f"return {number(episodes.mean_return)}")
    if status.ppo.kl is not None:
        parts.append(f"kl {number(status.ppo.kl, 2)}")
    if status.lag.mean is not None:
        parts.append(f"lag {number(status.lag.mean, 2)}")
    if status.validation is not None and status.validation.points:
        newest = status.validation.points[-1]
        if newest.sampled.episodes:
            share = 100 * newest.sampled.arrived / newest.sampled.episodes
            parts.append(f"validated {share:.1f}% at {newest.steps:,}")
    return "  ".join(parts).replace(MISSING, "-")


__all__ = ["Picture", "abreast", "alone", "draw", "plain_line", "render"]
