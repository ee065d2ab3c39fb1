"""The report as text: rows for a terminal and Markdown between the marks of a document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.table import Table

from lndrl.config import LocalizationConfig
from lndrl.errors import UserError
from lndrl.evaluation.localization.figures import (
    RECOVERED_FOR,
    RECOVERED_WITHIN,
    Cell,
)
from lndrl.evaluation.localization.replay import TROUBLES
from lndrl.evaluation.localization.report import Report
from lndrl.evaluation.metrics import Rate
from lndrl.wording import counted

BEGIN = "<!-- figures: everything from here to the end mark is written by the command -->"
END = "<!-- end of figures -->"
LOGS_BEGIN = "<!-- laser logs: everything from here to the end mark is written by the command -->"
LOGS_END = "<!-- end of laser logs -->"
_MISSING = "–"

Row = tuple[str, ...]


def accuracy_rows(cells: Sequence[Cell]) -> tuple[Row, list[Row]]:
    """Head and rows of the accuracy table, as text."""
    head = (
        "scenario", "people", "setting", "position RMSE (m)", "95 %", "median", "worst",
        "yaw RMSE (rad)", "median", "lost drives", "time lost", "N", "N_eff", "µs",
    )  # fmt: skip
    rows: list[Row] = [
        (
            cell.scenario,
            str(cell.pedestrians),
            cell.setting,
            _metres(cell.position_rmse),
            "–".join(_metres(end) for end in cell.position_interval),
            _metres(cell.position_median),
            _metres(cell.worst),
            _metres(cell.yaw_rmse),
            _metres(cell.yaw_median),
            _rate(cell.lost),
            _percent(cell.lost_time),
            f"{cell.particles:.0f}",
            f"{cell.effective:.0f}",
            f"{cell.microseconds:.0f}",
        )
        for cell in cells
    ]
    return head, rows


def recovery_rows(cells: Sequence[Cell]) -> tuple[Row, list[Row]]:
    """Head and rows of the recovery table, as text: share and median seconds by trouble."""
    head = (
        "scenario", "people", "setting", *(t for name in TROUBLES.values() for t in (name, "s"))
    )  # fmt: skip
    rows = [
        (
            cell.scenario,
            str(cell.pedestrians),
            cell.setting,
            *(text for kind in TROUBLES for text in _recovery(cell, kind)),
        )
        for cell in cells
    ]
    return head, rows


def _recovery(cell: Cell, kind: str) -> Row:
    seconds = cell.seconds[kind]
    return _rate(cell.recovered[kind]), _MISSING if seconds is None else f"{seconds:.1f}"


def report_tables(report: Report) -> list[Table]:
    """What a terminal shows: accuracy and recovery, every cell and all scenarios together."""
    cells = report.cells()
    if len(report.plan.scenarios) > 1:
        cells += report.summary()
    tables = []
    for title, (head, rows) in (
        ("localization on recorded drives", accuracy_rows(cells)),
        ("recovery: share of drives and median seconds", recovery_rows(cells)),
    ):
        table = Table(title=title, title_justify="left")
        for i, name in enumerate(head):
            table.add_column(name, justify="right" if i not in (0, 2) else "left")
        for row in rows:
            table.add_row(*row)
        tables.append(table)
    return tables


def report_markdown(report: Report, command: str, machine: str, picture: str) -> str:
    """The generated part of the document; ``picture`` is the name of the image beside it."""
    plan = report.plan
    tick = plan.world.tick
    seconds = plan.updates * tick
    parts = [
        f"`{command}`",
        f"{counted(plan.seeds, 'drive')} of {seconds:.0f} s ({plan.updates} updates) "
        f"per scenario and crowd; {machine}.",
        f"![Position error of every drive, and of one drive over time]({picture})",
        "### Settings",
        settings_text(plan.settings),
        "### Drives",
        _drives_text(report),
    ]
    if len(plan.scenarios) > 1:
        parts += [
            "### All scenarios together",
            markdown_table(*accuracy_rows(report.summary())),
            markdown_table(*recovery_rows(report.summary())),
        ]
    parts += [
        "### Accuracy",
        "RMSE: mean over drives with its bootstrap interval, and median; worst: the largest error "
        f"of any update. Lost: more than {plan.task.lost_distance:g} m or "
        f"{plan.task.lost_angle:.3f} rad off at any time, with the Wilson interval. N and N_eff "
        "are mean counts of particles, µs the median time of an update while the report ran.",
        markdown_table(*accuracy_rows(report.cells())),
        "### Recovery",
        f"Share of drives (Wilson interval) whose position error falls below {RECOVERED_WITHIN:g} "
        f"m and stays so for {RECOVERED_FOR:g} s before the drive ends, {0.5 * seconds:.0f} s "
        "after the trouble, and the median seconds until then; a dash where most never do.",
        markdown_table(*recovery_rows(report.cells())),
    ]
    return "\n\n".join(parts)


def write_document(path: Path, generated: str, begin: str = BEGIN, end: str = END) -> None:
    """Put ``generated`` between the marks of ``path``; a file that is not there becomes one.

    Raises UserError when an existing file has no marks or cannot be written.
    """
    check_document(path, begin, end)
    block = f"{begin}\n\n{generated}\n\n{end}"
    if path.exists():
        text = path.read_text(encoding="utf-8")
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        text = before + block + after
    else:
        text = f"# Localization\n\n{block}\n"
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror})") from None


def check_document(path: Path, begin: str = BEGIN, end: str = END) -> None:
    """Raise UserError unless ``write_document`` can write ``path``: before the work, not after."""
    if path.suffix != ".md":
        raise UserError(f"--out {path}: must end in .md")
    if not path.parent.is_dir():
        raise UserError(f"--out {path}: the folder {path.parent} does not exist")
    if not path.exists():
        return
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({error})") from None
    if begin not in text or end not in text.partition(begin)[2]:
        raise UserError(
            f"{path}: has no place for the figures; put the lines {begin} and {end} into it"
        )


def settings_text(settings: Mapping[str, LocalizationConfig]) -> str:
    """Every setting by what it changes against the first."""
    first, *others = settings
    base = settings[first].model_dump()
    lines = [f"- **{first}**: {_keys(base)}" if not others else f"- **{first}**: the base"]
    for label in others:
        changes = {
            k: v for k, v in settings[label].model_dump().items() if base[k] != v and k != "preset"
        }
        lines.append(f"- **{label}**: {_keys(changes) or 'the same'}")
    return "\n".join(lines)


def _keys(values: Mapping[str, object]) -> str:
    return ", ".join(f"`{key}: {value}`" for key, value in values.items())


def _drives_text(report: Report) -> str:
    head = ("scenario", "people", "driven (m)", "goals", "wall contacts", "people contacts")
    rows = []
    for scenario in report.plan.scenarios:
        for people in report.plan.pedestrians:
            drives = [
                d for d in report.drives if d.scenario == scenario.name and d.pedestrians == people
            ]
            rows.append(
                (
                    scenario.name,
                    str(people),
                    f"{sum(d.length for d in drives) / len(drives):.1f}",
                    f"{sum(d.goals_reached for d in drives) / len(drives):.1f}",
                    str(sum(d.wall_hits for d in drives)),
                    str(sum(d.pedestrian_hits for d in drives)),
                )
            )
    return "Means per drive; contacts are counted over all drives.\n\n" + markdown_table(head, rows)


def markdown_table(head: Row, rows: Sequence[Row]) -> str:
    """``head`` and ``rows`` as a table of Markdown."""
    lines = [_line(head), "|" + "---|" * len(head)]
    lines += [_line(row) for row in rows]
    return "\n".join(lines)


def _line(cells: Row) -> str:
    return "| " + " | ".join(cells) + " |"


def _metres(value: float) -> str:
    return f"{value:.3f}" if value < 0.9995 else f"{value:.2f}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _rate(rate: Rate) -> str:
    low, high = rate.interval
    return f"{rate.count}/{rate.episodes} ({low:.2f}–{high:.2f})"
