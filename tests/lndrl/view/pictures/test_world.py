from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from PIL import Image

from lndrl.errors import UserError
from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.view.palette import GOAL, PERSON, TRUTH, WALL
from lndrl.view.pictures.film import save_gif, save_strip, strip_view
from lndrl.view.pictures.world import close_view, save_png, scan_points, world_figure

Make = Callable[..., WorldSnapshot]


def pixels(path: Path) -> NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def amount(image: NDArray[np.uint8], colour: str) -> int:
    wanted = np.array(to_rgb(colour)) * 255
    return int((np.abs(image.astype(float) - wanted).max(axis=-1) < 4).sum())


@pytest.mark.parametrize("close_up", [True, False])
def test_picture_shows_robot_walls_and_goal(make: Make, tmp_path: Path, close_up: bool) -> None:
    save_png(make(outcome="arrived"), tmp_path / "w.png", close_up=close_up)
    image = pixels(tmp_path / "w.png")
    for colour in (TRUTH, WALL, GOAL):
        assert amount(image, colour) > 50


def test_robot_is_drawn_where_it_is(make: Make) -> None:
    figure = world_figure(make(), close_up=False)
    figure.set_dpi(100)
    figure.canvas.draw()
    image = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    x, y = figure.axes[0].transData.transform(make().pose_true[:2] - [0.1, 0.1])
    column, row = round(x), image.shape[0] - 1 - round(y)
    assert amount(image[row - 2 : row + 3, column - 2 : column + 3], TRUTH) > 10


def test_empty_parts_are_no_trouble(make: Make, tmp_path: Path) -> None:
    save_png(make(steps=0, people=0, particles=0), tmp_path / "w.png")
    assert amount(pixels(tmp_path / "w.png"), PERSON[""]) < 100


def test_beams_end_where_they_should(make: Make) -> None:
    snapshot = make()
    points = scan_points(snapshot)
    distance = np.hypot(*(points - snapshot.pose_true[:2]).T)
    assert distance == pytest.approx(snapshot.scan, abs=1e-5)
    first = np.arctan2(*(points[0] - snapshot.pose_true[:2])[::-1])
    assert first == pytest.approx(snapshot.pose_true[2] - np.pi / 2, abs=1e-5)
    middle = np.arctan2(*(points[45] - snapshot.pose_true[:2])[::-1])
    assert middle == pytest.approx(snapshot.pose_true[2], abs=1e-5)


def test_close_view_stays_in_the_place(make: Make) -> None:
    assert close_view(make(), 4.0) == pytest.approx((1.0, 5.0, 0.0, 4.0))


def test_film_has_one_picture_per_snapshot(make: Make, tmp_path: Path) -> None:
    snapshots = [make(steps=k) for k in (2, 6, 10)]
    told: list[int] = []
    save_gif(snapshots, tmp_path / "w.gif", fps=5, pixels=480, progress=told.append)
    with Image.open(tmp_path / "w.gif") as film:
        assert getattr(film, "n_frames", 1) == 3
        assert film.width == 480
        film.seek(2)
        assert film.info["duration"] > 1000
        assert amount(np.asarray(film.convert("RGB")), TRUTH) > 20
    assert told == [1, 2, 3]


def test_strip_shows_all_of_the_path(make: Make, tmp_path: Path) -> None:
    snapshots = [make(steps=k) for k in range(0, 10)]
    left, right, bottom, top = strip_view(snapshots)
    for point in (*snapshots[-1].path, snapshots[-1].goal):
        assert left <= point[0] <= right and bottom <= point[1] <= top
    for count in (1, 3, 4):
        save_strip(snapshots, tmp_path / "s.png", count=count)
        assert pixels(tmp_path / "s.png").shape[1] == 1560


def test_nothing_to_show_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nothing to show"):
        save_gif([], tmp_path / "w.gif")
    with pytest.raises(UserError, match="nothing to show"):
        save_strip([], tmp_path / "w.png")


def test_pyplot_stays_out() -> None:
    assert "lndrl.view.pictures.world" in sys.modules
    source = Path(sys.modules["lndrl.view.pictures.world"].__file__ or "").read_text()
    assert "import matplotlib.pyplot" not in source and "import pyplot" not in source


@pytest.fixture
def make(world: Make) -> Make:
    return world
