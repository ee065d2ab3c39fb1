"""What an evaluator finds of the newest weights, as a panel and as a line of the dashboard."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from lndrl.transport.status import Counts, Status
from lndrl.view.dashboard.panels import Panel
from lndrl.view.palette import OUTCOME, OUTCOME_WORD
from lndrl.view.text import beside, duration, fit, percent, sparkline, styled
from lndrl.wilson import wilson_interval


def panel(status: Status, width: int) -> Panel:
    """How the newest weights did in validation, with 95 % intervals, and how that has moved."""
    found = status.validation
    assert found is not None
    note = f"{found.episodes} episodes a round" if found.episodes else ""
    if not found.points:
        words = "under way" if found.heard is not None else "no evaluator has come yet"
        return Panel("validation", [fit(styled(words, "dim"), width)], note)
    newest = found.points[-1]
    lines = []
    for label, kind in (("sampled", "sampled"), ("greedy", "greedy")):
        past = [_arrivals(getattr(point, kind)) for point in found.points]
        lines.append(_validated(label, getattr(newest, kind), past, width))
    words = " · ".join(
        f"{OUTCOME_WORD[key]} {percent(_share(newest.sampled, key))}"
        for key in OUTCOME
        if key != "arrived"
    )
    best = found.best
    kept = "" if best is None else f"best {percent(_arrivals(best.sampled))} at {best.steps:,}"
    lines.append(beside(styled(f"  {words}", "dim"), styled(kept, "dim"), width))
    age = duration(max(0.0, status.time - newest.unix))
    place = f"step {newest.steps:,}, {age} ago"
    return Panel("validation", [fit(line, width) for line in lines], f"{place} · {note}")


def line(status: Status, width: int) -> Text:
    """The newest validation in one line."""
    found = status.validation
    words = styled("validation", "bold")
    if found is None or not found.points:
        return fit(words.append("  none yet", style="dim"), width)
    newest, best = found.points[-1], found.best
    words.append(f"  {percent(_arrivals(newest.sampled))}", style="bold default")
    words.append(f" arrived ({_interval(newest.sampled)}) at {newest.steps:,}", style="default")
    if best is not None:
        words.append(f"  best {percent(_arrivals(best.sampled))} at {best.steps:,}", style="dim")
    return fit(words, width)


def _validated(label: str, counts: Counts, past: Sequence[float | None], width: int) -> Text:
    """``label  arrivals  sparkline  interval`` in ``width`` cells."""
    colour = OUTCOME["arrived"]
    line = styled(f"{label:<10}", colour).append(
        f"{percent(_arrivals(counts)):>8}", style="bold default"
    )
    interval = f"95 %: {_interval(counts)}" if counts.episodes else ""
    room = max(width - line.cell_len - 2 - 16, 0)
    line.append("  ").append(f"{sparkline(past, room):<{room}}", style=colour)
    return line.append(f"{interval:>16}", style="dim")


def _share(counts: Counts, key: str) -> float | None:
    return getattr(counts, key) / counts.episodes if counts.episodes else None


def _arrivals(counts: Counts) -> float | None:
    return _share(counts, "arrived")


def _interval(counts: Counts) -> str:
    """95 % Wilson interval of the arrivals in percent."""
    if not 0 < counts.episodes >= counts.arrived:
        return ""
    low, high = wilson_interval(counts.arrived, counts.episodes)
    return f"{100 * low:.0f} to {100 * high:.0f}"
