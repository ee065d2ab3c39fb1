"""Every word of every picture lies in it, however narrow the place and long its name."""

from __future__ import annotations

import dataclasses

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lndrl.navigation import WorldSnapshot
from lndrl.scenario import Scenario
from lndrl.view.pictures.fitting import add_legend, shortened, text_width, wrapped
from lndrl.view.pictures.scenario import sample_start, scenario_figure
from lndrl.view.pictures.world import legend_handles, world_figure
from lndrl.world import Place
from tests.lndrl.view.pictures.uncut import words_cut_off

LONG = "the-third-floor-of-the-west-wing-as-it-was-mapped-in-march-with-all-doors-open"
SIZES = [(6.0, 60.0), (60.0, 6.0), (6.0, 6.0), (20.0, 20.0)]


def place(width: float, height: float, name: str) -> Place:
    ends = {"start": [0.5, 0.5, 2, 2], "goal": [width - 2, height - 2, width - 0.5, height - 0.5]}
    people = {"count": [4, 4], "routes": [ends]}
    plain = {"name": name, "size": [width, height], "pedestrians": people, "robot": [ends]}
    return Place.build(Scenario.model_validate(plain))


@pytest.mark.parametrize("name", ["hall", LONG, LONG.replace("-", " "), "x" * 200])
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_pictures_of_scenarios(width: float, height: float, name: str) -> None:
    there = place(width, height, name)
    figure = scenario_figure(there, f"{name}   {width:g} × {height:g} m, 4 people")
    assert words_cut_off(figure) == []
    drawn = figure.axes[0].get_title(loc="left").replace("\n", "").replace(" ", "")
    assert drawn == f"{name}{width:g}×{height:g}m,4people".replace(" ", "")


@pytest.mark.parametrize("outcome", ["", "collided"])
@pytest.mark.parametrize("name", ["hall", LONG, "x" * 200])
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_pictures_of_worlds(width: float, height: float, name: str, outcome: str) -> None:
    there = place(width, height, name)
    snapshot: WorldSnapshot = dataclasses.replace(sample_start(there), outcome=outcome)
    for close_up in (True, False):
        for dpi in (60.0, 130.0):
            figure = world_figure(snapshot, close_up=close_up)
            assert figure.get_figheight() < 14.0
            assert words_cut_off(figure, dpi) == []
            title, word = figure.axes[0].title, figure.axes[0]._right_title  # type: ignore[attr-defined]
            left = figure.axes[0]._left_title.get_window_extent()  # type: ignore[attr-defined]
            assert title.get_text() == "" and word.get_text() == outcome
            assert not outcome or word.get_window_extent().x0 > left.x1


def test_a_title_is_broken_between_words_and_else_within() -> None:
    assert wrapped("one two", 11, 9.0) == "one two"
    assert wrapped("one two", 11, text_width("one tw", 11)) == "one\ntwo"
    lines = wrapped("a " + 90 * "b", 11, 2.0).split("\n")
    assert lines[0] == "a" and len(lines) > 3
    assert all(text_width(line, 11) <= 2.0 for line in lines)


def test_what_is_shortened_keeps_both_ends() -> None:
    assert shortened("corridor, episode 7", 11, 9.0) == "corridor, episode 7"
    short = shortened(f"{LONG}, episode 7", 11, 3.0)
    assert text_width(short, 11) <= 3.0
    assert short.startswith("the-third") and "…" in short and short.endswith(", episode 7")


def test_a_legend_takes_the_columns_that_there_is_room_for() -> None:
    heights = []
    for width in (12.0, 5.0, 2.2):
        figure = Figure(figsize=(width, 4.0))
        FigureCanvasAgg(figure)
        heights.append(add_legend(figure, legend_handles(), 6, fontsize=9))
        assert words_cut_off(figure) == []
        assert len(figure.legends) == 1
    assert heights[0] < heights[1] < heights[2]
