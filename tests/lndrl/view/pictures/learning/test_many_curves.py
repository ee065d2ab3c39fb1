"""Several runs in one picture: lines, marks, words and the table."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from lndrl.errors import UserError
from lndrl.view.pictures.learning.curves import SMOOTHING
from lndrl.view.pictures.learning.many_curves import (
    Curves,
    many_figure,
    names_of,
    save_many_curves,
    write_many_csv,
)
from tests.lndrl.view.pictures.uncut import words_cut_off


def validated(steps: int, arrived: int) -> dict[str, Any]:
    counts = {"episodes": 20, "arrived": arrived, "collided": 20 - arrived, "lost": 0, "timeout": 0}
    return {"steps": steps, "sampled": counts, "greedy": counts}


def run(name: str, arrived: float, updates: int = 40, marks: bool = True) -> Curves:
    rows = [
        {
            "update": i,
            "steps": 1000 * i,
            "episodes": {"count": 8, "arrived": arrived, "collided": 1 - arrived, "lost": 0.0},
        }
        for i in range(1, updates + 1)
    ]
    curve = [validated(0, 0), validated(4000, 10), validated(20_000, 20)] if marks else []
    return Curves(name, rows, curve)


TEN = [
    run(f"run-{k}" + "-as-long-as-names-are" * (k == 3), 0.05 * k, 20 + 2 * k) for k in range(10)
]


def test_the_best_run_is_named_first_and_no_word_is_cut_off() -> None:
    figure = many_figure(TEN)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names[0] == "run-9  45 %" and names[9] == "run-0  0 %"
    assert "mean of 1,520 steps" in names[10].replace("\n", " ")
    assert words_cut_off(figure) == []


def test_ten_runs_can_be_told_apart() -> None:
    large = many_figure(TEN).axes[0]
    lines = [line for line in large.lines if len(np.atleast_1d(line.get_xdata())) > 10]
    looks = {(to_hex(line.get_color()), line.get_linestyle()) for line in lines}
    assert len(lines) == len(looks) == 10


def test_marks_are_validated_shares_with_intervals() -> None:
    axes = many_figure([run("one", 0.5), run("two", 0.5, marks=False)]).axes
    (bars,) = axes[0].containers
    steps, shares = bars[0].get_data()
    assert list(steps) == [4000, 20_000] and list(shares) == [50.0, 100.0]
    (bars,) = axes[1].containers
    assert list(bars[0].get_data()[1]) == [50.0, 0.0]


def test_the_window_is_as_many_steps_for_short_runs() -> None:
    """Else a long run would look smoother than a short one."""
    rows = [{"steps": 1000 * i, "episodes": {"arrived": float(i == 50)}} for i in range(1, 101)]
    longest = 1e6
    wide = [np.count_nonzero(Curves("a", rows).share("arrived", SMOOTHING * longest)[1])]
    wide.append(np.count_nonzero(Curves("a", rows[:60]).share("arrived", SMOOTHING * longest)[1]))
    assert wide[0] == 41  # 40,000 steps
    assert wide[1] == 60 - 50 + 20 + 1


def test_rows_without_figures_are_left_out(tmp_path: Path) -> None:
    empty = Curves("empty", [{}, {"episodes": None}, {"steps": 3}])
    assert len(empty.share("arrived", 10.0)[0]) == 0
    save_many_curves([empty, TEN[3]], tmp_path / "c.png")
    assert (tmp_path / "c.png").stat().st_size > 1000
    with pytest.raises(UserError, match="nothing to draw"):
        save_many_curves([Curves("a", []), Curves("b", [])], tmp_path / "d.png")


def test_one_table_has_all_runs(tmp_path: Path) -> None:
    write_many_csv([run("one", 0.5, 2), run("two", 0.25, 3, marks=False)], tmp_path / "t.csv")
    with open(tmp_path / "t.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    kinds = [(row["run"], row["kind"]) for row in rows]
    marks = [("one", "sampled"), ("one", "greedy")] * 3
    assert kinds == [("one", "training")] * 2 + marks + [("two", "training")] * 3
    assert (rows[0]["steps"], rows[0]["episodes"], rows[0]["arrived"]) == ("1000", "8", "0.5")
    assert rows[0]["timeout"] == ""
    assert (rows[4]["steps"], rows[4]["episodes"], rows[4]["collided"]) == ("4000", "20", "0.5")


def test_runs_of_one_name_are_called_by_their_paths() -> None:
    assert names_of([Path("runs/a"), Path("old/a"), Path("runs/b")]) == ["runs/a", "old/a", "b"]
