"""Charts of how often methods arrive, collide and get lost."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from lndrl.view.pictures.rates import Share, rates_figure, results_figure, shares_of
from tests.lndrl.evaluation.benchmark.results.rows import row, share

SHARES = [
    Share("ours", 0.9, (0.85, 0.95), 0.8),
    Share("a method with quite a long name of its own", 0.1, (0.0, 0.2)),
]


def results(**outcomes: str) -> Any:
    """What a picture reads of results with these rows."""
    rows = [row(method, ends) for method, ends in outcomes.items()]
    return SimpleNamespace(rows=rows, name="v2", identity=SimpleNamespace(bench_version=2))


def dots(axes: Axes) -> list[tuple[float, float]]:
    return [tuple(np.asarray(each.get_offsets())[0].tolist()) for each in axes.collections]


def test_a_dot_stands_at_its_share_and_a_diamond_at_the_papers() -> None:
    (axes,) = rates_figure("arrived", SHARES).axes
    assert dots(axes) == [(90.0, 0.0), (80.0, 0.0), (10.0, 1.0)]
    assert [np.asarray(line.get_xdata()).tolist() for line in axes.lines] == [
        [85.0, 95.0],
        [0.0, 20.0],
    ]


def test_shares_are_counted_from_nothing() -> None:
    for shares in (SHARES, SHARES[:1]):
        (axes,) = rates_figure("arrived", shares).axes
        low, high = axes.get_xlim()
        assert low <= 0.0 and high >= 95.0


def test_a_row_is_beside_what_the_paper_has_of_it() -> None:
    found = results(lndrl=share(3, 1, episodes=4), careful=share(1, 0, 1, episodes=4))
    ours, other = shares_of(found, "lost")
    assert (ours.method, ours.value, ours.published) == ("lndrl", 0.25, 0.003)
    assert ours.interval == found.rows[0].metrics.lost.interval
    assert (other.method, other.value, other.published) == ("careful", 0.0, None)
    alone = shares_of(results(**{"no_reward-alone": "aal"}), "lost")
    assert [each.published for each in alone] == [0.03]


def test_at_a_glance_every_row_has_a_line_in_each_of_three_panels() -> None:
    rows = {"lndrl": "aaac", "careful": "allc", **{f"row{i}": "aacl" for i in range(25)}}
    figure = results_figure(results(**rows))
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["arrived", "collided", "lost"]
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == list(rows)
    assert all(axes.get_xlim()[0] <= 0.0 for axes in figure.axes)
    for axes, ours, paper, theirs in zip(
        figure.axes, (75.0, 25.0, 0.0), (89.2, 10.4, 0.3), (25.0, 25.0, 50.0), strict=True
    ):
        found = dots(axes)
        assert found[0] == (ours, 0.0) and found[2] == (theirs, 1.0)
        np.testing.assert_allclose(found[1], (paper, 0.0))
        assert len(found) == len(rows) + 1  # the paper's
    figure.canvas.draw()
    boxes = [label.get_window_extent() for label in figure.axes[0].get_yticklabels()]
    assert all(upper.y0 >= lower.y1 for upper, lower in itertools.pairwise(boxes))
