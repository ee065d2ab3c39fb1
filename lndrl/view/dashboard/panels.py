"""The dashboard's panels: each is a title and lines of exactly the width it is given."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rich.text import Text

from lndrl.transport.status import (
    ACTOR_ACTIVITIES,
    IMITATION,
    LEARNER_ACTIVITIES,
    HistoryRow,
    Status,
)
from lndrl.view.dashboard.health import (
    LABELS,
    OF_A_TEACHER,
    SHORT_LABELS,
    Finding,
    findings,
)
from lndrl.view.dashboard.verdict import STALE_AFTER, headline
from lndrl.view.palette import (
    BAD,
    BLUE,
    GOOD,
    GREEN,
    ORANGE,
    OUTCOME,
    OUTCOME_WORD,
    PINK,
    QUIET,
    SKY,
    WARNING,
)
from lndrl.view.text import (
    BLOCKS,
    beside,
    duration,
    finite,
    fit,
    named_shares,
    number,
    percent,
    printable,
    progress_bar,
    sparkline,
    stacked_bar,
    styled,
    wrap,
)

PART_COLOURS = (GREEN, SKY, ORANGE, PINK, QUIET, BLUE)
"""Of an actor's and of a learner's activities: work green and sky, waiting quiet, other blue."""
EVENT_COLOURS = {
    "join": GOOD,
    "resume": GOOD,
    "checkpoint": SKY,
    "validated": GOOD,
    "operator": SKY,
    "leave": WARNING,
    "gone": WARNING,
    "slow": WARNING,
    "restart": WARNING,
    "refused": BAD,
    "error": BAD,
    "nan": BAD,
}


@dataclass(frozen=True)
class Panel:
    """``lines`` under ``title``; ``note`` stands flush right beside the title."""

    title: str
    lines: list[Text] = field(default_factory=list)
    note: str = ""
    shown: int = 0
    """Rows of what scrolls."""


def header(status: Status, width: int, stale_age: float, rows: int = 3) -> Panel:
    """Verdict, progress, rates and, in ``rows``, where the time of learner and actors goes."""
    verdict = headline(status, stale_age)
    word = styled(f"{verdict.mark} {verdict.word.upper()}", f"bold {verdict.colour}")
    sentence = wrap(verdict.sentence, width - word.cell_len - 2, limit=1)[0]
    if word.cell_len + 2 + len(verdict.sentence) <= width:
        lines = [word.append("  ").append(sentence, style="default")]
    else:
        lines = [word, *(Text(f"  {line}") for line in wrap(verdict.sentence, width - 2, 2))]
    age = f"updated {duration(stale_age)} ago" if stale_age > STALE_AFTER else ""
    notes = [age or f"up {duration(status.uptime)}"]
    lines += [_progress(status, width, verdict.colour), *_rates(status, width)]
    lines += _time_split(
        "learner", status.time_split, LEARNER_ACTIVITIES, width, rows=2 if rows > 2 else 1
    )
    if rows > 1:
        lines += _time_split("actors", status.actor_split, ACTOR_ACTIVITIES, width, rows=1)
    name = printable(status.run_name or status.run_id) or "a run"
    return Panel(f"lndrl · {name}", [fit(line, width) for line in lines], " · ".join(notes))


def _progress(status: Status, width: int, colour: str) -> Text:
    share = status.steps / status.total_steps if status.total_steps else 0.0
    words = styled(f"  {100 * min(share, 1):.1f} %", "bold")
    words.append(f"  {status.steps:,} of {status.total_steps:,} steps", style="default")
    return progress_bar(share, max(width - words.cell_len, 4), colour).append_text(words)


def _rates(status: Status, width: int) -> list[Text]:
    rate = status.rate
    speeds = styled(f"{number(rate.seconds_10)}", "bold")
    speeds.append(
        f" · {number(rate.seconds_60)} · {number(rate.seconds_300)} steps/s", style="default"
    )
    if width >= 70:
        speeds.append("  over 10 · 60 · 300 s", style="dim")
    done = status.state == "done"
    eta = styled("finished" if done else f"{duration(status.eta)} left", "bold")
    lag, dropped = status.lag, status.dropped
    facts = [f"update {status.updates:,}"]
    if status.phase:
        end = "" if status.phase_until is None else f" until {status.phase_until:,}"
        facts.insert(0, f"{printable(status.phase)}{end}")
    if lag.mean is not None:
        most = "" if lag.max is None else f" (max {lag.max})"
        facts.append(f"lag {number(lag.mean, 2)}{most}")
    rules = ("stale", "restart", "end", "diverged", "duplicate", "refused")
    losses = {rule: getattr(dropped, rule) for rule in rules}
    named = ", ".join(f"{count:,} {name}" for name, count in losses.items() if count)
    facts.append(f"dropped {named or 'nothing'}")
    if status.checkpoint is not None:
        facts.append(f"checkpoint {duration(status.checkpoint.age)} ago")
    facts.append(f"queue {status.queue.chunks} ({number(status.queue.megabytes, 2)} MB)")
    if status.overhead_learner is not None and status.overhead_actor is not None:
        learner, actors = percent(status.overhead_learner, 0), percent(status.overhead_actor, 0)
        facts.append(f"overhead {learner} (actors {actors})")
    while len(facts) > 1 and len(" · ".join(facts)) > width:
        facts.pop()
    return [beside(speeds, eta, width), styled(" · ".join(facts), "dim")]


def _time_split(
    who: str, split: Mapping[str, float], order: Sequence[str], width: int, rows: int = 2
) -> list[Text]:
    """A bar and what its parts are: in one line, or in two where that is too long.

    Where there is only one row, the smallest parts go unnamed.
    """
    shares = named_shares(split, order)
    if not shares:
        return []
    label = f"{who:<8}"
    legends = []
    for i, (name, share) in enumerate(shares):
        mark, colour = BLOCKS[i % len(BLOCKS)], PART_COLOURS[i % len(PART_COLOURS)]
        legend = styled(f"{mark} ", colour)
        words = f"{printable(name)} {100 * share:.0f} %"
        legends.append((share, legend.append(words, style="default")))
    colours = [(s, PART_COLOURS[i % len(PART_COLOURS)]) for i, (_, s) in enumerate(shares)]

    def room_of_bar() -> int:
        return width - len(label) - sum(legend.cell_len + 2 for _, legend in legends)

    while rows == 1 and len(legends) > 1 and room_of_bar() < 12:
        legends.remove(min(legends, key=lambda pair: pair[0]))
    if (room := room_of_bar()) >= 12:
        bar = Text(label).append_text(stacked_bar(colours, room)).append("  ")
        return [bar.append_text(Text("  ").join(legend for _, legend in legends))]
    while len(legends) > 1 and sum(x.cell_len + 2 for _, x in legends) > width - len(label) + 2:
        legends.remove(min(legends, key=lambda pair: pair[0]))
    bar = Text(label).append_text(stacked_bar(colours, width - len(label)))
    return [bar, Text(" " * len(label)) + Text("  ").join(legend for _, legend in legends)]


def outcomes(status: Status, history: Sequence[HistoryRow], width: int) -> Panel:
    """How the last episodes ended, and how that share has moved since the history begins."""
    episodes = status.episodes
    shares = [(getattr(episodes, key) or 0.0, colour) for key, colour in OUTCOME.items()]
    lines = [stacked_bar(shares, width)]
    for i, (key, colour) in enumerate(OUTCOME.items()):
        past = [getattr(row, key) for row in history]
        label = f"{BLOCKS[i]} {OUTCOME_WORD[key]}"
        value = percent(getattr(episodes, key))
        lines.append(_trend(label, value, past, colour, width, lambda v: f"{100 * v:.0f}"))
    returns = [row.mean_return for row in history]
    value = number(episodes.mean_return)
    lines.append(_trend("  return", value, returns, SKY, width, lambda v: number(v, 2)))
    facts = [
        f"{episodes.mean_time:.1f} s" if episodes.mean_time is not None else "",
        f"{episodes.mean_distance:.1f} m" if episodes.mean_distance is not None else "",
        f"position error {episodes.position_error:.2f} m"
        if episodes.position_error is not None
        else "",
    ]
    lines.append(styled("  " + " · ".join(fact for fact in facts if fact), "dim"))
    note = f"last {episodes.window:,} of {episodes.count:,} episodes" if episodes.count else ""
    return Panel("outcomes", [fit(line, width) for line in lines], note)


def _trend(
    label: str,
    value: str,
    past: Sequence[float | None],
    colour: str,
    width: int,
    show: Callable[[float], str],
) -> Text:
    """``label  value  sparkline  lowest–highest`` in ``width`` cells."""
    line = styled(f"{label:<10}", colour).append(f"{value:>8}", style="bold default")
    seen = finite(past)
    span = f"{show(min(seen))} to {show(max(seen))}" if seen else ""
    room = max(width - line.cell_len - 2 - 14, 0)
    line.append("  ").append(f"{sparkline(past, room):<{room}}", style=colour)
    return line.append(f"{span:>14}", style="dim")


def ppo(status: Status, width: int, columns: int = 2) -> Panel:
    """Numbers of the newest update in ``columns``; those out of their healthy range say so."""
    found = {finding.key: finding for finding in findings(status)}
    room = (width - 2 * (columns - 1)) // columns
    shown = [
        key for key in LABELS if key not in OF_A_TEACHER or getattr(status.ppo, key) is not None
    ]
    cells = [_measure(status, key, found.get(key), room) for key in shown]
    rows = math.ceil(len(cells) / columns)
    lines = [Text("  ").join(cells[row::rows]) for row in range(rows)]
    worst = list(found.values())
    style = BAD if worst and worst[0].severe else WARNING
    for finding in worst[:3]:
        words = wrap(finding.sentence, width - 2, 2)
        lines += [styled(f"{'  ' if i else '! '}{line}", style) for i, line in enumerate(words)]
    if not worst and status.updates:
        lines.append(styled("all in healthy ranges", "dim"))
    title = IMITATION if status.phase == IMITATION else "PPO"
    return Panel(title, [fit(line, width) for line in lines], f"update {status.updates:,}")


def _measure(status: Status, key: str, finding: Finding | None, width: int) -> Text:
    wide = width >= 23
    value = number(getattr(status.ppo, key), 3 if wide else 2)
    mark = "" if finding is None else ("!!" if finding.severe else "!")
    style = "bold" if finding is None else f"bold {BAD if finding.severe else WARNING}"
    label = LABELS[key] if wide else SHORT_LABELS[key]
    return beside(styled(label, "dim"), styled(f"{value}{mark:<2}", style), width)


def ppo_line(status: Status, width: int) -> Text:
    """The four most telling numbers of the newest update in one line."""
    found = {finding.key: finding for finding in findings(status)}
    line = styled("PPO", "bold")
    for key in ("entropy", "kl", "clip_fraction", "explained_variance"):
        finding = found.get(key)
        style = "default" if finding is None else (BAD if finding.severe else WARNING)
        mark = "" if finding is None else ("!!" if finding.severe else "!")
        line.append(f"  {SHORT_LABELS[key]} ", style="dim")
        line.append(f"{number(getattr(status.ppo, key), 2)}{mark}", style=style)
    return fit(line, width)


def events(status: Status, width: int, rows: int, back: int = 0) -> Panel:
    """``rows`` lines of the log, newest last; ``back`` newer ones are left out."""
    lines = []
    end = len(status.events) - min(back, max(len(status.events) - rows, 0))
    for event in status.events[max(end - rows, 0) : end]:
        clock = time.strftime("%H:%M:%S", time.localtime(event.time))
        line = styled(f"{clock}  ", "dim")
        colour = EVENT_COLOURS.get(event.kind.lower(), "default")
        line.append(f"{printable(event.kind)[:10]:<10}  ", style=colour)
        lines.append(line.append(printable(event.text), style="default"))
    if not lines:
        lines = [styled("nothing yet", "dim")]
    newer = len(status.events) - end
    note = f"{newer} newer below" if newer else ""
    return Panel("events", [fit(line, width) for line in lines], note, shown=len(lines))
