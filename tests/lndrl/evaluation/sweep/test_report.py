"""A sweep's tables, document, picture and status line."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from PIL import Image
from rich.console import Console

from lndrl.errors import UserError
from lndrl.evaluation.sweep import Job, Progress, SweepFigures, sweep_figures
from lndrl.view.document import write_between_marks
from lndrl.view.pictures.learning.sweep_curves import save_sweep
from lndrl.view.sweep import (
    SweepDisplay,
    outcome_rows,
    status_line,
    sweep_markdown,
    sweep_tables,
)
from tests.lndrl.evaluation.sweep.helpers_sweep import rows_of, small_sweep, write_run


@pytest.fixture
def figures(tmp_path: Path) -> SweepFigures:
    """Two seeds of everything but ``eight``, which has one; ``one`` arrives more often."""
    sweep, folder = small_sweep(tmp_path)
    for run in sweep.runs():
        if run.name == "eight-s2":
            continue
        every = 10 - run.seed - (3 if run.variant.name == "one" else 0)
        outcomes = ["arrived" if i % every == 0 else "collided" for i in range(900)]
        write_run(folder, run, rows_of(outcomes, 900, 45))
    return sweep_figures(folder)


def test_the_table_shows_the_spread_and_marks_what_is_clear(figures: SweepFigures) -> None:
    head, rows = outcome_rows(figures)
    base, one, eight = (dict(zip(head[:4], row[:4], strict=True)) for row in rows)
    assert (base["seeds"], eight["seeds"]) == ("2 of 2", "1 of 2")
    # every ninth and eighth episode, then every sixth and fifth
    assert base["arrived (%)"] == "11.8 ± 1.2" and base["Δ"] == "–"
    assert one["arrived (%)"] == "18.3 ± 2.4"
    assert one["Δ"] == "+6.5 ± 0.8 [−4.1, +17.1]"
    assert eight["Δ"] == "+0.0 (one pair)"
    drawn = Console(width=200, file=io.StringIO())
    for table in sweep_tables(figures):
        drawn.print(table)
    assert "ppo.epochs=8 ppo.clip=0.1" in drawn.file.getvalue()  # type: ignore[attr-defined]


def test_the_document_keeps_what_stands_around(figures: SweepFigures, tmp_path: Path) -> None:
    text = sweep_markdown(figures)
    assert "| one | 2 of 2 | 18.3 ± 2.4 | +6.5 ± 0.8 [−4.1, +17.1] |" in text
    assert "- **one**: less" in text
    path = tmp_path / "doc.md"
    path.write_text("a\n<!-- sweep small -->\nold\n<!-- end -->\nb\n<!-- end -->\n")
    write_between_marks(path, "sweep", "small", text)
    write_between_marks(path, "sweep", "small", text)
    kept = path.read_text()
    assert kept.startswith("a\n<!-- sweep small -->\n\n| variant")
    assert kept.endswith("\n\n<!-- end -->\nb\n<!-- end -->\n")
    assert "old" not in kept and kept.count("| variant |") == 2
    with pytest.raises(UserError, match="put the lines <!-- sweep other --> and"):
        write_between_marks(path, "sweep", "other", text)
    write_between_marks(tmp_path / "new.md", "sweep", "small", "words")
    assert (tmp_path / "new.md").read_text() == "<!-- sweep small -->\n\nwords\n\n<!-- end -->\n"


def test_the_picture_is_drawn(figures: SweepFigures, tmp_path: Path) -> None:
    save_sweep(figures, tmp_path / "sweep.png")
    with Image.open(tmp_path / "sweep.png") as image:
        assert image.width > 400
    with pytest.raises(UserError, match="no run of the sweep is finished"):
        save_sweep(SweepFigures(figures.sweep, figures.variants, ()), tmp_path / "none.png")


def test_the_status_line_says_what_is_left(figures: SweepFigures) -> None:
    job = Job(figures.sweep.runs()[1], "train")
    progress = Progress(1, 6, 4600, 10.0, ((job, 400),))
    line = status_line(progress, 1000)
    assert line == ("1 of 6 runs done, one-s1: 400 of 1,000 steps, 10.0 steps/s, 7 min 40 s left")
    stream = io.StringIO()
    with SweepDisplay(1000, stream) as display:
        display.say("one-s1: starts")
        display.show(progress)
    assert stream.getvalue().endswith(" one-s1: starts\n") and stream.getvalue().count("\n") == 1
