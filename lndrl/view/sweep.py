"""A sweep as text: how far it is, what it found as tables, and those in a Markdown document."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from rich import box
from rich.table import Table
from rich.text import Text

from lndrl.view.document import Row, markdown_table
from lndrl.view.progress import StatusLine
from lndrl.view.text import MISSING, duration, number
from lndrl.wording import counted

if TYPE_CHECKING:
    from lndrl.evaluation.sweep import Estimate, Progress, SweepFigures, VariantFigures

LINE_EVERY = 300.0
"""s between lines where there is no terminal; a sweep takes hours."""

MARK = " *"
"""Ends a difference whose 95 % interval leaves 0 out."""


# -- while it works -----------------------------------------------------------------------------


def status_line(progress: Progress, steps: int) -> str:
    """How a sweep of runs of ``steps`` steps stands, on one line."""
    parts = [f"{progress.done} of {progress.runs} runs done"]
    for job, done in progress.active:
        what = "evaluation" if job.kind == "evaluate" else f"{done:,} of {steps:,} steps"
        parts.append(f"{job.run.name}: {what}")
    parts.append(f"{number(progress.rate)} steps/s")
    parts.append(f"{duration(progress.seconds_left)} left")
    return ", ".join(parts)


class SweepDisplay(StatusLine):
    """One line that changes, on a terminal; else a line every five minutes. Writes to stderr."""

    def __init__(self, steps: int, stream: TextIO | None = None) -> None:
        super().__init__(LINE_EVERY, at_once=False, stream=stream)
        self._steps = steps

    def show(self, progress: Progress) -> None:
        """The line that changes."""
        self.update(status_line(progress, self._steps))


# -- tables -------------------------------------------------------------------------------------


def outcome_rows(figures: SweepFigures) -> tuple[Row, list[Row]]:
    """Head and rows: how episodes end, with the differences to the base."""
    tested = figures.sweep.spec.episodes > 0
    head = ["variant", "seeds", "arrived (%)", "Δ", "area (%)", "Δ", "collided (%)", "lost (%)"]
    head += ["tested: arrived (%)", "Δ"] if tested else []
    rows = []
    for variant in figures.variants:
        row = [
            variant.name,
            _seeds(variant, len(figures.sweep.spec.seeds)),
            *_with_difference(variant, "arrived", _points),
            *_with_difference(variant, "area", _points),
            _spread(variant.estimates["collided"], _points),
            _spread(variant.estimates["lost"], _points),
        ]
        row += _with_difference(variant, "test_arrived", _points) if tested else ()
        rows.append(tuple(row))
    return tuple(head), rows


def learning_rows(figures: SweepFigures) -> tuple[Row, list[Row]]:
    """Head and rows: how it learned, and what each variant changes."""
    head = (
        "variant", "return", "Δ", "KL", "entropy (nat)", "explained variance", "steps/s", "changes",
    )  # fmt: skip
    rows = [
        (
            variant.name,
            *_with_difference(variant, "return", _number),
            *(
                _spread(variant.estimates[name], _number)
                for name in ("kl", "entropy", "explained_variance", "steps_per_second")
            ),
            " ".join(variant.settings) or MISSING,
        )
        for variant in figures.variants
    ]
    return head, rows


def legend(figures: SweepFigures) -> list[str]:
    """Sentences that say what the tables show, and how much it is worth."""
    spec = figures.sweep.spec
    head, rows = outcome_rows(figures)
    marked = (head.count("Δ") + 1) * (len(rows) - 1)
    count = len(spec.seeds)
    kind = "serial run" if spec.serial else "run"
    tested = (
        f" Tested: {counted(spec.episodes, 'episode')} of the final policy, "
        f"{'greedy' if spec.greedy else 'sampled'} actions."
        if spec.episodes
        else ""
    )
    return [
        f"Mean ± sample standard deviation over {counted(count, kind)} of {spec.steps:,} steps "
        f"(seeds {', '.join(map(str, spec.seeds))}). Area: mean of the arrival curve over all "
        f"steps. All others but steps/s: over the last third of the steps.{tested}",
        "Δ: difference to the base, paired by seed: mean ± standard error [95 % t interval], "
        f"{MARK.strip()} where the interval leaves 0 out; of the {marked} differences about "
        f"{0.05 * marked:.1f} would be marked by chance alone."
        + (f" {counted(count, 'seed is', 'seeds are')} weak evidence." if count < 10 else ""),
    ]


def sweep_tables(figures: SweepFigures) -> list[Table]:
    """What a terminal shows."""
    tables = []
    for title, (head, rows) in (
        (f"sweep {figures.sweep.name}: how episodes end", outcome_rows(figures)),
        ("how it learned", learning_rows(figures)),
    ):
        table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
        for i, name in enumerate(head):
            table.add_column(Text(name), justify="left" if i == 0 or name == "changes" else "right")
        for row in rows:
            table.add_row(*(Text(cell, "bold" if cell.endswith(MARK) else "") for cell in row))
        tables.append(table)
    return tables


def sweep_markdown(figures: SweepFigures) -> str:
    """Tables, legend and what each variant is for, as Markdown."""
    parts = [markdown_table(*outcome_rows(figures)), markdown_table(*learning_rows(figures))]
    parts += [line.replace("*", "\\*") for line in legend(figures)]
    common = " ".join(f"`{setting}`" for setting in figures.sweep.spec.set)
    if common:
        parts.append(f"All runs: {common}.")
    parts.append(
        "\n".join(f"- **{each.name}**: {each.why}" for each in figures.variants if each.settings)
    )
    return "\n\n".join(parts)


def _seeds(variant: VariantFigures, planned: int) -> str:
    words = f"{len(variant.seeds)} of {planned}"
    return f"{words}, {len(variant.diverged)} diverged" if variant.diverged else words


def _with_difference(
    variant: VariantFigures, name: str, say: Callable[[float], str]
) -> tuple[str, str]:
    difference = variant.differences.get(name)
    return (
        _spread(variant.estimates[name], say),
        MISSING if difference is None else _difference(difference, say),
    )


def _spread(estimate: Estimate, say: Callable[[float], str]) -> str:
    if estimate.mean is None:
        return MISSING
    if estimate.deviation is None:
        return say(estimate.mean)
    return f"{say(estimate.mean)} ± {say(estimate.deviation)}"


def _difference(estimate: Estimate, say: Callable[[float], str]) -> str:
    if estimate.mean is None:
        return MISSING
    interval = estimate.interval
    if interval is None or estimate.deviation is None:
        return f"{_signed(estimate.mean, say)} (one pair)"
    error = estimate.deviation / estimate.count**0.5
    low, high = (_signed(end, say) for end in interval)
    mark = MARK if estimate.clear else ""
    return f"{_signed(estimate.mean, say)} ± {say(error)} [{low}, {high}]{mark}"


def _signed(value: float, say: Callable[[float], str]) -> str:
    words = say(abs(value))
    return f"−{words}" if value < 0 else f"+{words}"


def _points(share: float) -> str:
    return f"{100.0 * share:.1f}"


def _number(value: float) -> str:
    return _minus(number(value))


def _minus(words: str) -> str:
    """A proper minus before a number; exponents keep theirs."""
    return f"−{words[1:]}" if words.startswith("-") else words
