"""One panel on the whole screen: what it shows when it has the room."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.text import Text

from lndrl.transport.status import MOST_LAG, HistoryRow, Status, Validated
from lndrl.view.chart import Interval, area_chart, bars, interval_chart, span_line
from lndrl.view.dashboard import panels, validated
from lndrl.view.dashboard.actors import actors
from lndrl.view.dashboard.health import LABELS, LIMITS
from lndrl.view.dashboard.machines import machines
from lndrl.view.dashboard.panels import Panel
from lndrl.view.dashboard.view import KEYS, View
from lndrl.view.palette import BLUE, OUTCOME, OUTCOME_WORD, PINK, SKY
from lndrl.view.text import BLOCKS, beside, fit, number, percent, styled
from lndrl.wilson import wilson_interval


def zoomed(
    status: Status, history: Sequence[HistoryRow], view: View, width: int, rows: int
) -> Panel:
    """The panel that ``view`` looks at, in at most ``rows`` lines of ``width`` cells."""
    if view.focus == "machines":
        panel = machines(status, width, rows)
    elif view.focus == "actors":
        panel = actors(status, width, rows, view)
    elif view.focus == "events":
        panel = panels.events(status, width, rows, view.back)
    elif view.focus == "validation":
        panel = _validation(status, width, rows)
    elif view.focus == "ppo":
        panel = _ppo(status, history, width, rows)
    else:
        panel = _outcomes(status, history, width, rows)
    del panel.lines[rows:]
    return panel


def help_panel(width: int, rows: int) -> Panel:
    """The keys."""
    room = max(len(key) for key, _ in KEYS) + 2
    lines = [styled(f"{key:<{room}}", "bold").append(words, style="default") for key, words in KEYS]
    lines = [fit(line, width) for line in lines]
    return Panel("keys", lines[:rows], "any key closes this")


def _outcomes(status: Status, history: Sequence[HistoryRow], width: int, rows: int) -> Panel:
    short = panels.outcomes(status, history, width)
    each = (rows - 2) // 5
    if each < 3 or not history:
        return short
    lines = [short.lines[0]]
    for i, (key, colour) in enumerate(OUTCOME.items()):
        past = [getattr(row, key) for row in history]
        name = styled(f"{BLOCKS[i]} {OUTCOME_WORD[key]}", colour)
        lines += _titled(name, percent(getattr(status.episodes, key)), past, colour, width, each)
    returns = [row.mean_return for row in history]
    value = number(status.episodes.mean_return)
    lines += _titled(
        styled("return", SKY), value, returns, SKY, width, each, lambda v: number(v, 3)
    )
    return Panel(short.title, [*lines, _steps(history, width)], short.note)


def _titled(
    name: Text,
    value: str,
    past: Sequence[float | None],
    colour: str,
    width: int,
    rows: int,
    show: Callable[[float], str] = lambda v: percent(v),
) -> list[Text]:
    """A chart under its name and newest value, ``rows`` in all."""
    title = fit(name.append(f"  {value}", style="bold default"), width)
    return [title, *area_chart(past, width, rows - 1, colour, show)]


def _steps(history: Sequence[HistoryRow], width: int) -> Text:
    return span_line(f"step {history[0].steps:,}", f"step {history[-1].steps:,}", width)


def _ppo(status: Status, history: Sequence[HistoryRow], width: int, rows: int) -> Panel:
    columns = 3 if width >= 100 else 2
    panel = panels.ppo(status, width, columns)
    lines = list(panel.lines)
    limits = [
        styled(f"  {LABELS[key]:<14} ", "default").append(
            f"{'above' if limit.above else 'below'} {limit.warn:g}: {limit.meaning}", style="dim"
        )
        for key, limit in LIMITS.items()
    ]
    curves = (
        ("KL", [row.kl for row in history], BLUE),
        ("entropy", [row.entropy for row in history], PINK),
        ("lag", [row.lag for row in history], SKY),
    )
    lags = status.lag.shares
    if lags and rows - len(lines) >= len(lags) + 2:
        lines.append(fit(styled("lag of the last batch, in versions", "dim"), width))
        labels = [f"{i}{'+' if i == MOST_LAG else ''}" for i in range(len(lags))]
        lines += bars(list(zip(labels, lags, strict=True)), width, SKY)
    each = (rows - len(lines) - 1) // len(curves)
    if rows - len(lines) - len(limits) - 2 >= 4 * len(curves):
        lines += [fit(styled("what is worth a warning", "dim"), width), *limits]
        each = (rows - len(lines) - 1) // len(curves)
    if each >= 3 and history:
        for name, past, colour in curves:
            value = number(past[-1])
            lines += _titled(
                styled(name, colour), value, past, colour, width, each, lambda v: number(v, 3)
            )
        lines.append(_steps(history, width))
    return Panel(panel.title, [fit(line, width) for line in lines], panel.note)


def _validation(status: Status, width: int, rows: int) -> Panel:
    if status.validation is None:
        words = styled("this run is not validated", "dim")
        return Panel("validation", [fit(words, width)])
    panel = validated.panel(status, width)
    points = status.validation.points
    each = (rows - len(panel.lines) - 1) // 2
    if len(points) < 2 or each < 4:
        return panel
    lines = list(panel.lines)
    for kind, mark in (("sampled", "●"), ("greedy", "○")):
        found = [point for p in points if (point := _interval(p, kind)) is not None]
        title = styled(f"{mark} {kind}, arrived of all, 95 % intervals", OUTCOME["arrived"])
        lines.append(fit(title, width))
        lines += interval_chart(found, width, each - 1, OUTCOME["arrived"], percent, mark)
    lines.append(span_line(f"step {points[0].steps:,}", f"step {points[-1].steps:,}", width))
    return Panel(panel.title, lines, panel.note)


def _interval(point: Validated, kind: str) -> Interval | None:
    counts = getattr(point, kind)
    if not 0 < counts.episodes >= counts.arrived:
        return None
    low, high = wilson_interval(counts.arrived, counts.episodes)
    return Interval(point.steps, counts.arrived / counts.episodes, low, high)


def bar(left: str, width: int, right: str = "? help  q leaves") -> Text:
    """The last line of a live picture: what is going on, and where help is."""
    return beside(styled(left, "bold"), styled(right, "dim"), width)
