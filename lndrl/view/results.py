"""A results folder as text: tables for a terminal and the same for a Markdown document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from lndrl.evaluation.benchmark.paper import EPISODES, SCENARIOS
from lndrl.evaluation.benchmark.results.repeated import ENDS
from lndrl.evaluation.benchmark.table import (
    Cell,
    metric_cells,
    metric_head,
    probability,
    published_cells,
)
from lndrl.view.document import Row, markdown_table
from lndrl.view.text import MISSING

if TYPE_CHECKING:
    from lndrl.evaluation.benchmark.results import Difference, Results

VERDICT = {True: "met", False: "not met", None: "not there yet"}
_STYLE = {"met": "green", "not met": "red", "not there yet": "dim"}
_LARGE = 10.0
_OUTCOMES = ("arrival", "collision", "lost", "stuck")


def metric_rows(results: Results, between: str = " ") -> tuple[Row, list[Row]]:
    """Head and rows: the nine metrics and the hazard, the paper's row below ours."""
    head = ("method", "episodes", *metric_head())
    rows: list[Row] = []
    for row in results.rows:
        cells = (_with_interval(cell, between) for cell in metric_cells(row))
        rows.append((row.method, f"{len(row.records):,}", *cells))
        published = published_cells(row.method)
        if published is not None:
            whole = f"{EPISODES * SCENARIOS:,}"
            rows.append(("  published", whole, *(MISSING if p == "-" else p for p in published)))
    return head, rows


def scenario_rows(results: Results) -> tuple[Row, list[Row]]:
    """Head and rows: how episodes end in every scenario, in per cent."""
    names = list(dict.fromkeys(s for row in results.rows for s in row.scenarios))
    rows = []
    for row in results.rows:
        cells = []
        for name in names:
            metrics = row.within(name).metrics
            rates = [100 * getattr(metrics, outcome).value for outcome in _OUTCOMES]
            known = name in row.scenarios
            cells.append(" / ".join(f"{rate:.1f}" for rate in rates) if known else MISSING)
        rows.append((row.method, *cells))
    return ("method", *names), rows


def paired_rows(results: Results, between: str = " ") -> tuple[Row, list[Row]]:
    """Head and rows: the reference less every other row, in points."""
    head = ("against", "episodes", "arrived", "p", "pairs", "lost", "p", "pairs")
    rows = [
        (
            each.method,
            f"{each.arrived.episodes:,}",
            *_difference(each.arrived, between),
            *_difference(each.lost, between),
        )
        for each in results.comparisons
    ]
    return head, rows


def goal_rows(results: Results) -> tuple[Row, list[Row]]:
    """Head and rows: every goal, what is seen of it, and the verdict."""
    rows: list[Row] = [
        (each.goal, each.seen or MISSING, VERDICT[each.met]) for each in results.goals
    ]
    return ("goal", "seen", "verdict"), rows


def repeated_rows(results: Results, between: str = " ") -> tuple[Row, list[Row]]:
    """Head and rows: what trainings under other seeds come to, and what chance is worth in one."""
    head = ("trained alike", *(cell for end in ENDS for cell in (end, "chance")))
    rows: list[Row] = []
    for each in results.repeated:
        cells = []
        for end in ENDS:
            found = each.over_trainings(end)
            mean, (low, high) = found.mean, found.interval or (0.0, 1.0)
            cells += [
                f"{mean:.3f}{between}({max(low, 0.0):.3f}–{min(high, 1.0):.3f})",
                f"{100 * min(each.chance(end), 1.0):.1f}",
            ]
        rows.append((", ".join(each.methods), *cells))
    return head, rows


def training_rows(results: Results) -> tuple[Row, list[Row]]:
    """Head and rows: how the policies were trained that were tested."""
    rows: list[Row] = []
    for training, methods in results.trainings:
        counts = training.validated
        arrived = MISSING
        if counts is not None:
            share = counts["arrived"] / counts["episodes"]
            arrived = f"{share:.3f} ({counts['episodes']:,} episodes)"
        rows.append(
            (
                ", ".join(methods),
                str(training.seed),
                f"{training.steps:,}",
                f"{training.seconds / 60:.0f}",
                f"{training.tested:,}",
                arrived,
                training.machine or MISSING,
            )
        )
    head = ("rows", "seed", "steps", "minutes", "tested: that of step", "validated", "machine")
    return head, rows


def captions(results: Results) -> dict[str, str]:
    """A sentence or two above each of the six tables, by the table's name."""
    identity, name = results.identity, results.reference.method
    return {
        "metrics": f"Version {identity.bench_version} of the bench, seed {identity.seed}, all "
        "scenarios together, with 95 % intervals; h is lost per 1,000 control steps.",
        "scenarios": "Arrived / collided / lost / stuck in every scenario (%).",
        "pairs": f"{name} less each other row over the same episodes: points with paired 95 % "
        f"intervals, exact McNemar p, and in how many episodes only {name} : only the other ended "
        "so.",
        "repeated": "Rows that differ in their training's seed alone: the mean over trainings with "
        "Student's 95 % interval, and by how many points two single trainings differ at most, in "
        "95 % of cases, by chance. Both are wide where trainings are few.",
        "goals": f"Goals for {results.judged}.",
        "trainings": "How the policies were trained. Validated: how many arrived when the tested "
        "version was tried where it was trained, with actions drawn as there: less decided than in "
        "the test.",
    }


def _pages(results: Results, between: str) -> list[tuple[str, Row, list[Row]]]:
    """Caption, head and rows of every table that has any."""
    found = {
        "metrics": metric_rows(results, between),
        "scenarios": scenario_rows(results),
        "pairs": paired_rows(results, between),
        "repeated": repeated_rows(results, between),
        "goals": goal_rows(results),
        "trainings": training_rows(results),
    }
    words = captions(results)
    return [(words[name], head, rows) for name, (head, rows) in found.items() if rows]


def results_tables(results: Results) -> list[Table]:
    """What a terminal shows."""
    tables = []
    for title, head, rows in _pages(results, "\n"):
        table = Table(title=title, title_justify="left")
        for i, name in enumerate(head):
            words = i == 0 or head[0] == "goal" or name == "machine"
            table.add_column(Text(name), justify="left" if words else "right")
        for row in rows:
            style = "dim" if row[0] == "  published" else None
            table.add_row(*(Text(cell, _STYLE.get(cell, "")) for cell in row), style=style)
        tables.append(table)
    return tables


def results_markdown(results: Results) -> str:
    """The tables with their captions, and what is not there, as Markdown."""
    parts = []
    for caption, head, rows in _pages(results, " "):
        parts += [caption, markdown_table(head, [_emphasized(row) for row in rows])]
    return "\n\n".join([*parts, *results.notes()])


def _emphasized(row: Row) -> Row:
    return ("_published_", *row[1:]) if row[0] == "  published" else row


def _with_interval(cell: Cell, between: str) -> str:
    """As many digits in the interval as in the figure; of seconds and metres one is enough."""
    if cell.value is None:
        return MISSING
    digits = 1 if cell.value >= _LARGE else cell.digits
    words = f"{cell.value:.{digits}f}"
    if cell.interval is None:
        return words
    low, high = cell.interval
    return f"{words}{between}({low:.{digits}f}–{high:.{digits}f})"


def _difference(difference: Difference, between: str) -> Sequence[str]:
    low, high = (_points(end) for end in difference.interval)
    return (
        f"{_points(difference.value)}{between}({low} to {high})",
        probability(difference.p),
        f"{difference.only_first:,} : {difference.only_second:,}",
    )


def _points(share: float) -> str:
    """A signed difference of rates; a proper minus."""
    return f"{100 * share:+.1f}".replace("-", "−")
