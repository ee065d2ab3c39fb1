from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from lndrl.errors import UserError
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.view.pictures.learning import curves
from lndrl.view.pictures.learning.curves import (
    column,
    save_curves,
    smooth,
    spread,
    write_csv,
    write_validated,
)

ROWS = [
    {
        "update": i,
        "steps": 1024 * i,
        "episodes": {"count": i, "arrived": 0.01 * i, "collided": 0.5, "lost": 0.1},
        "ppo": {"kl": 0.01, "entropy": math.nan if i == 3 else 3.0},
    }
    for i in range(1, 40)
]


def test_files_are_written(tmp_path: Path) -> None:
    save_curves(ROWS, tmp_path / "curves.png", title="a run")
    with Image.open(tmp_path / "curves.png") as image:
        assert image.width > 1000
    write_csv(ROWS, tmp_path / "curves.csv")
    with open(tmp_path / "curves.csv", newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 39
    assert (table[4]["update"], table[4]["steps"], table[4]["arrived"]) == ("5", "5120", "0.05")
    assert table[4]["timeout"] == table[2]["entropy"] == ""


@pytest.mark.parametrize("rows", [ROWS[:1], [{}], [{"steps": 1, "episodes": None}, {"ppo": 3}]])
def test_missing_keys_are_tolerated(rows: list[dict[str, object]], tmp_path: Path) -> None:
    save_curves(rows, tmp_path / "c.png")
    write_csv(rows, tmp_path / "c.csv")
    assert (tmp_path / "c.png").stat().st_size > 1000


def validated(steps: int, arrived: int) -> dict[str, Any]:
    counts = {"episodes": 20, "arrived": arrived, "collided": 20 - arrived, "lost": 0, "timeout": 0}
    return {"steps": steps, "sampled": counts, "greedy": counts}


def test_the_validated_curve_and_phases_are_drawn(tmp_path: Path, monkeypatch) -> None:
    drawn: list[Any] = []
    draw = curves._draw_validated

    def watched(axes: Any, curve: Any) -> None:
        draw(axes, curve)
        drawn.append(axes)

    monkeypatch.setattr(curves, "_draw_validated", watched)
    rows = [{**row, "phase": "imitation" if i < 20 else "guided"} for i, row in enumerate(ROWS)]
    save_curves(rows, tmp_path / "c.png", validated=[validated(4096, 10), validated(8192, 20)])
    (axes,) = drawn
    (bars,) = axes.containers
    steps, shares = bars[0].get_data()
    assert list(steps) == [4096, 8192] and list(shares) == [50.0, 100.0]
    words = [text.get_text() for text in axes.texts]
    assert "imitation" in words and "guided" in words
    assert axes.get_legend().get_texts()[0].get_text() == "validated, 20 episodes each"


def test_words_of_short_phases_stand_below_each_other() -> None:
    axes = Figure().subplots()
    steps = np.array([0.0, 50.0, 100.0, 900.0, 1000.0])
    names = ("imitation", "guided", "reinforcement", "imitation", "imitation")
    curves._draw_phases(axes, steps, [{"phase": name} for name in names])
    assert [text.get_position()[1] for text in axes.texts] == [-12, -23, -34, -12]


def test_phases_that_are_no_words_are_left_out(tmp_path: Path) -> None:
    rows = [{**row, "phase": phase} for row, phase in zip(ROWS, ([], {}, "guided"), strict=False)]
    save_curves(rows, tmp_path / "c.png")
    assert (tmp_path / "c.png").stat().st_size > 1000


def test_validated_rates_are_written(tmp_path: Path) -> None:
    write_validated([validated(4096, 10)], tmp_path / "v.csv")
    with open(tmp_path / "v.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    assert (row["steps"], row["episodes"]) == ("4096", "20")
    assert (row["sampled_arrived"], row["greedy_collided"]) == ("0.5", "0.5")
    assert row["sampled_lost"] == "0"


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nothing to draw"):
        save_curves([], tmp_path / "c.png")


def test_smoothing_keeps_means_and_ignores_gaps() -> None:
    assert smooth(np.full(50, 3.0)) == pytest.approx(3.0)
    values = np.array([1.0, math.nan, 3.0])
    assert smooth(values, share=1.0)[1] == pytest.approx(2.0)
    line = np.arange(101.0)
    assert smooth(line, 0.1)[5:-5] == pytest.approx(line[5:-5])


def test_column_takes_only_numbers() -> None:
    values = [{"b": 1}, 3, {"b": True}, {"b": "x"}]
    rows: list[dict[str, Any]] = [*({"a": value} for value in values), {}]
    assert column(rows, "a.b")[0] == 1.0
    assert np.isnan(column(rows, "a.b")[1:]).all()


def test_labels_keep_apart_and_in_bounds() -> None:
    placed = spread([98.0, 97.0, 0.0, 1.0], gap=5.0, low=2.0, high=98.0)
    assert sorted(placed) == [placed[i] for i in (2, 3, 1, 0)]
    assert np.diff(sorted(placed)).min() >= 5.0
    assert min(placed) >= 2.0 and max(placed) <= 98.0


def test_metrics_are_read_and_refused(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    with pytest.raises(UserError, match="no such file"):
        read_metrics(path)
    path.write_text("")
    with pytest.raises(UserError, match="holds no rows"):
        read_metrics(path)
    path.write_text('{"steps": 1}\n{"steps": 2}\n{"ste')
    assert [row["steps"] for row in read_metrics(path)] == [1, 2]
    path.write_text('{"steps": 1}\nnonsense\n{"steps": 2}\n')
    with pytest.raises(UserError, match="line 2"):
        read_metrics(path)
