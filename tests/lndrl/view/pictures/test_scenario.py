"""Drawings of places show their regions, routes and metres."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from lndrl.config import load_scenario
from lndrl.view.pictures.scenario import sample_start, save_scenario, scenario_figure
from lndrl.world import Place


@pytest.fixture(scope="module")
def office() -> Place:
    return Place.build(load_scenario("office"))


def test_every_region_is_drawn_and_metres_are_the_maps(office) -> None:
    axes = scenario_figure(office, "an office").axes[0]
    boxes = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert len(boxes) == 2 * len(office.scenario.robot)
    assert axes.get_title(loc="left") == "an office"
    marks = dict(
        zip(axes.get_xticks(), [t.get_text() for t in axes.get_xticklabels()], strict=True)
    )
    assert marks[4.0] == "0"  # the map's x = 0 is 4 m from the grid's corner
    left, right = axes.get_xlim()
    assert left == 0.0 and right == pytest.approx(30.0)


def test_the_sample_looks_towards_its_goal(office) -> None:
    snapshot = sample_start(office)
    ahead = snapshot.goal - snapshot.pose_true[:2]
    heading = np.array([np.cos(snapshot.pose_true[2]), np.sin(snapshot.pose_true[2])])
    assert ahead @ heading > 0.7 * np.hypot(*ahead)
    assert len(snapshot.pedestrian_position) >= 8


def test_pictures_are_small_files(office, tmp_path) -> None:
    save_scenario(office, tmp_path / "office.png")
    assert 5_000 < (tmp_path / "office.png").stat().st_size < 150_000
    with pytest.raises(OSError):
        save_scenario(office, tmp_path / "away" / "office.png")
