"""The dashboard as a pure function of the learner's status: panels arranged to fit a terminal."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.console import Group
from rich.text import Text

from lndrl.transport.status import HistoryRow, Status
from lndrl.view.dashboard import panels, validated
from lndrl.view.dashboard.panels import Panel
from lndrl.view.dashboard.verdict import headline
from lndrl.view.text import MISSING, duration, fit, number, styled

NARROWEST = 40
ROOMY = (78, 32)
"""Columns and rows from which panels get borders instead of a ruled title."""
TWO_COLUMNS = 76
SHORT = (28, 22)
"""Rows from which both sides' time has up to three rows, and from which it has two."""
EVENTS_LISTED = 10
"""Events shown where the height is free (``--once``)."""


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
    width = max(width, NARROWEST)
    boxed = width >= ROOMY[0] and (height is None or height >= ROOMY[1])
    inside = width - 4 if boxed else width
    splits = 3 if height is None or height >= SHORT[0] else 2 if height >= SHORT[1] else 1
    top = _frame(panels.header(status, inside, stale_age, splits), width, boxed)
    middle = _middle(status, history, width, boxed)
    if height is None:
        rows = (len(status.actors) + 1, EVENTS_LISTED)
    else:
        middle = _as_fits(status, history, width, boxed, middle, height - len(top))
        left = height - len(top) - sum(map(len, middle)) - 2 * (1 + boxed)
        rows = _share_rows(left, len(status.actors) + 1, len(status.events))
    lines = top + [line for block in middle for line in block]
    if rows[0] >= 2 or (rows[0] and not status.actors):
        lines += _frame(panels.actors(status, inside, rows[0]), width, boxed)
    if rows[1]:
        log = panels.events(status, inside, rows[1])
        log = Panel(log.title, log.lines, hint)
        if height is not None and boxed:
            spare = height - len(lines) - len(log.lines) - 2
            log.lines.extend(fit(Text(), inside) for _ in range(spare))
        lines += _frame(log, width, boxed)
    return Group(*lines[:height])


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
    results = [_frame(panels.outcomes(status, history, width - 4 * boxed), width, boxed)]
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
    status: Status, history: Sequence[HistoryRow], width: int, boxed: bool
) -> list[list[Text]]:
    """Outcomes and PPO as blocks of lines: one block side by side, or two, the first more vital.

    Last comes validation, where the run has any.
    """
    margin = 4 if boxed else 0
    last = []
    if status.validation is not None:
        last = [_frame(validated.panel(status, width - margin), width, boxed)]
    if width < TWO_COLUMNS:
        return [
            _frame(panels.outcomes(status, history, width - margin), width, boxed),
            _frame(panels.ppo(status, width - margin, columns=3), width, boxed),
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
    pairs = zip(_frame(first, left, boxed), _frame(second, right, boxed), strict=True)
    return [[a.copy().append(" " * gap).append_text(b) for a, b in pairs], *last]


def _share_rows(left: int, actors: int, events: int) -> tuple[int, int]:
    """Rows for the actor table (with heading) and for the log, out of ``left``."""
    if left <= 0:
        return 0, 0
    log = min(max(events, 1), 3, left // 3)
    table = min(actors, left - log)
    return table, left - table


def _frame(panel: Panel, width: int, boxed: bool) -> list[Text]:
    """The panel's lines between borders, or under a ruled title."""
    left, line, right = ("╭─ ", "─", "─╮") if boxed else ("", "─", "")
    title = styled(left, "dim").append(panel.title, style="bold").append(" ")
    words = f" {panel.note}{' ' if boxed else ''}" if panel.note else ""
    note = styled(words + right, "dim")
    room = width - title.cell_len - note.cell_len
    if room < 1:
        note, room = styled(right, "dim"), width - title.cell_len - len(right)
    title.append(line * max(room, 0), style="dim").append_text(note)
    if not boxed:
        return [fit(title, width), *panel.lines]
    body = [styled("│ ", "dim").append_text(row).append(" │", style="dim") for row in panel.lines]
    for row in body:
        row.no_wrap = True
    bottom = styled(f"╰{'─' * (width - 2)}╯", "dim")
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


__all__ = ["plain_line", "render"]
