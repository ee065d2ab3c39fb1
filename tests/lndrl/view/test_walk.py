from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rich.cells import cell_len

from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.view.walk import METRES, walk_legend, walk_picture, walk_words

World = Callable[..., WorldSnapshot]


def letters(snapshot: WorldSnapshot, columns: int = 50, rows: int = 15) -> list[str]:
    return walk_picture(snapshot, columns, rows, colours=False).plain.split("\n")


def at(snapshot: WorldSnapshot, point: Any, lines: list[str]) -> str:
    """The letter of a place of the made-up room, all of which (10 m by 6 m) fits."""
    column, row = (np.asarray(point) / METRES).astype(int)
    return lines[len(lines) - 1 - row // 2][column]


@pytest.mark.parametrize("colours", [True, False])
@pytest.mark.parametrize(("columns", "rows"), [(79, 20), (30, 6), (200, 60), (1, 1)])
def test_a_picture_fits_whatever_the_terminal(
    world: World, columns: int, rows: int, colours: bool
) -> None:
    lines = walk_picture(world(), columns, rows, colours).plain.split("\n")
    assert 0 < len(lines) <= rows
    assert {cell_len(line) for line in lines} == {min(columns, 50)}


def test_walls_people_goal_robot_and_belief_stand_where_they_are(world: World) -> None:
    shown = world(people=1)
    off = shown.pose_true + np.array([0.0, 1.0, 0.0])
    shown = replace(
        shown,
        pose_estimated=off,
        pedestrian_position=np.array([[7.1, 1.1]]),
        scan=np.full(90, shown.range_max, np.float32),
    )
    lines = letters(shown)
    assert len(lines) == 15 and lines[0] == "#" * 50 and lines[-1] == "#" * 50
    assert at(shown, (4.9, 2.5), lines) == "#"  # the block in the middle
    assert at(shown, (7.1, 1.1), lines) == "o"
    assert at(shown, shown.goal, lines) == "G"
    assert at(shown, shown.pose_true[:2], lines) == "R"
    assert at(shown, off[:2], lines) == "e"
    assert at(shown, shown.path[0], lines) == "."
    assert not any("'" in line for line in lines)  # no echo, no letter for it


def test_a_small_terminal_sees_the_robot_and_where_the_goal_lies(world: World) -> None:
    shown = replace(world(people=0), goal=np.array([9.5, 5.5]))
    lines = letters(shown, 20, 8)
    assert any("R" in line or "e" in line for line in lines)
    assert lines[0][-1] == "G"


def test_the_colours_are_those_of_the_letters(world: World) -> None:
    shown = world()
    text = walk_picture(shown, 50, 15, colours=True)
    assert set(text.plain) == {"▀", "\n"}
    assert len({span.style for span in text.spans}) > 5


def test_words_and_legend_fit_into_80_columns(world: World) -> None:
    assert len(walk_words(world(steps=150))) <= 80
    for colours in (True, False):
        assert cell_len(walk_legend(colours).plain) <= 80
    assert "R robot" in walk_legend(False).plain
    assert walk_words(world(people=0)).startswith("  4.0 s,")


def test_one_person_is_no_people(world: World) -> None:
    shown = world(people=1)
    near = replace(shown, pedestrian_position=shown.pose_true[None, :2] + 1.0)
    far = replace(shown, pedestrian_position=shown.pose_true[None, :2] + 3.0)
    assert ", 1 person within 3 m" in walk_words(near)
    assert ", 0 people within 3 m" in walk_words(far)
