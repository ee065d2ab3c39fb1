"""The picture of how two methods behave otherwise: from courses made by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from lndrl.evaluation.behaviour import BehaviourReport
from lndrl.maps.grid import OccupancyGrid
from lndrl.view.palette import BLUE, VERMILLION
from lndrl.view.pictures.behaviour import _BLANK, behaviour_figure, save_behaviour
from tests.lndrl.evaluation.behaviour.courses import drawn
from tests.lndrl.view.pictures.uncut import words_cut_off

LONG = "the-policy-that-was-trained-in-march-with-all-doors-open-and-all-lights-on"


def report(size: tuple[float, float], names: tuple[str, str] = ("one", "two")) -> BehaviourReport:
    occupied = np.zeros((int(2 * size[1]), int(2 * size[0])), bool)
    occupied[0] = True
    courses = drawn(1, 40, size), drawn(2, 40, size, ("lost", "arrived"))
    return BehaviourReport(names, "room", OccupancyGrid(occupied, 0.5), courses)


@pytest.mark.parametrize("size", [(8.0, 8.0), (20.0, 4.0), (6.0, 14.0)])
def test_no_word_is_cut_off_and_no_map_lies_on_another(size: tuple[float, float]) -> None:
    figure = behaviour_figure(report(size, (LONG, f"{LONG}-2")))
    assert words_cut_off(figure) == []
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(boxes) == 6
    for i, one in enumerate(boxes):
        for other in boxes[:i]:
            apart = one.x0 >= other.x1 or other.x0 >= one.x1
            assert apart or one.y0 >= other.y1 or other.y0 >= one.y1


def test_colours_say_who_does_more_and_walls_and_unknown_stay_out() -> None:
    found = report((8.0, 8.0))
    axes = behaviour_figure(found).axes[0]
    image = np.asarray(axes.images[1].get_array())
    values = np.repeat(np.repeat(found.maps["turning"], 2, axis=0), 2, axis=1)
    assert image.shape == (16, 16, 4)
    assert (image[0, :, 3] == 0.0).all() and (image[1:, :, 3] == 1.0).all()
    warm = image[..., 0] - image[..., 2]  # red less blue
    assert (warm[values > 0.02] > 0).all() and (warm[values < -0.02] < 0).all()
    farthest = np.unravel_index(np.nanargmax(np.abs(values)), values.shape)
    end = VERMILLION if values[farthest] > 0 else BLUE
    assert image[farthest][:3] == pytest.approx(to_rgb(end), abs=0.02)
    unknown = image[np.isnan(values)][:, :3]
    assert len(unknown) and np.abs(unknown - to_rgb(_BLANK)).max() < 0.01


def test_the_picture_is_written(tmp_path: Path) -> None:
    save_behaviour(report((8.0, 6.0)), tmp_path / "b.png")
    assert (tmp_path / "b.png").stat().st_size > 10_000
