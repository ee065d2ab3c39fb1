"""Pictures of episodes: every drive is there, the charts say metres, radians and seconds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from lndrl.evaluation.benchmark import Drive
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.families import Family
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.view.palette import OUTCOME
from lndrl.view.pictures.activations import Activations, activations_figure, save_activations
from lndrl.view.pictures.trajectories import METHODS, save_trajectories, trajectories_figure
from lndrl.view.pictures.worst import Panel, save_worst, view_of, worst_figure
from tests.lndrl.view.pictures.uncut import words_cut_off

Make = Callable[..., Drive]


@pytest.fixture
def drive(world: Callable[..., Any]) -> Make:
    """Makes a drive of ten steps in a small world."""

    def make(
        method: str = "dwa", scenario: str = "hall", episode: int = 0, outcome: str = "arrived"
    ) -> Drive:
        end = world(steps=10, outcome=outcome)
        time = 0.4 * np.arange(11, dtype=np.float64)
        true = np.column_stack([end.path, np.full(11, 0.4)])
        values = (10, 4.0, 2.0, 0.1, 0.02, 0.3, -1.0, dict.fromkeys(REWARD_PARTS, 0.0))
        return Drive(
            method=method,
            scenario=scenario,
            record=EpisodeRecord(Family.BENCH.world(episode), 0, outcome, *values),  # type: ignore[arg-type]
            hit="wall" if outcome == "collided" else "",
            time=time,
            pose_true=true,
            pose_estimated=true + 0.05,
            position_error=0.05 * time,
            angle_error=0.01 * time,
            judged_error=(0.2, 0.04),
            people=np.repeat(end.pedestrian_position[None], 11, axis=0),
            end=end,
            lost_distance=2.0,
            lost_angle=0.785,
        )

    return make


def words(figure: Figure) -> str:
    return "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)


def test_drives_of_an_episode_share_map_and_charts(drive: Make) -> None:
    first, second = drive("dwa"), drive("lndrl", outcome="collided")
    figure = trajectories_figure([first, second])
    floor, position, angle = figure.axes
    assert floor.get_title(loc="left") == "hall, episode 0"
    assert "dwa: arrived after 4.0 s" in words(figure)
    assert "lndrl: collided with a wall after 4.0 s" in words(figure)
    assert "(m)" in position.get_ylabel()
    assert "(rad)" in angle.get_ylabel()
    assert angle.get_xlabel() == "time (s)"
    for axes, name, limit in ((position, "position_error", 2.0), (angle, "angle_error", 0.785)):
        mine, theirs, lost = axes.get_lines()
        np.testing.assert_array_equal(mine.get_xdata(), first.time)
        np.testing.assert_array_equal(mine.get_ydata(), getattr(first, name))
        assert [to_hex(line.get_color()).upper() for line in (mine, theirs)] == [*METHODS[:2]]
        assert np.all(np.asarray(lost.get_ydata()) == limit)
        assert axes.get_ylim()[1] > limit
    paths = [np.asarray(line.get_xydata()) for line in floor.get_lines()]
    for each in (first, second):
        for pose in (each.pose_true, each.pose_estimated):
            assert any(p.shape == (11, 2) and np.array_equal(p, pose[:, :2]) for p in paths)


def test_every_episode_has_a_column_and_methods_keep_their_colour(drive: Make) -> None:
    drives = [drive("a", "hall"), drive("b", "hall"), drive("b", "sparse"), drive("b", "sparse", 1)]
    figure = trajectories_figure(drives)
    assert len(figure.axes) == 9
    titles = [axes.get_title(loc="left") for axes in figure.axes[::3]]
    assert titles == ["hall, episode 0", "sparse, episode 0", "sparse, episode 1"]
    assert to_hex(figure.axes[4].get_lines()[0].get_color()).upper() == METHODS[1]


def test_the_page_has_a_panel_and_a_reason_for_each(drive: Make) -> None:
    outcomes = ["lost", "collided", "timeout", "arrived", "lost", "lost", "lost"]
    drives = [drive(episode=k, outcome=each) for k, each in enumerate(outcomes)]
    panels = [Panel(d) for d in drives]
    panels[1] = Panel(drives[1], "recorded: arrived after 9.6 s")
    figure = worst_figure(panels, "a title")
    assert len(figure.axes) == 7
    rows = {round(axes.get_position().y0, 3) for axes in figure.axes}
    assert len(rows) == 2
    for k, (axes, each) in enumerate(zip(figure.axes, drives, strict=True)):
        texts = {text.get_text(): text for text in axes.texts}
        assert f"{k + 1}.  hall, episode {k}" in texts
        assert texts[each.reason].get_color() == OUTCOME[each.record.outcome]
        assert ("recorded: arrived after 9.6 s" in texts) == (k == 1)
    assert [text.get_text() for text in figure.texts] == ["a title"]


def test_a_panel_shows_path_and_goal(drive: Make) -> None:
    made = drive()
    left, right, bottom, top = view_of(made)
    assert right - left == pytest.approx(top - bottom)
    assert right - left >= 9.0
    for x, y in (*made.pose_true[:, :2], made.end.goal):
        assert left < x < right
        assert bottom < y < top


def test_activations_stand_over_the_angle_of_their_beams(world: Callable[..., Any]) -> None:
    scans = np.full((3, 90), 4.0, np.float32)
    values = np.zeros((32, 29), np.float32)
    values[:, 20] = 1.0
    made = Activations(world(), scans, values, 3.0 * np.arange(29, dtype=np.float64) + 2.0)
    assert made.angles(np.array([0.0, 45.0])).tolist() == [-90.0, 0.0]
    figure = activations_figure(made, "a title")
    scene, _, scan, line, image, _ = figure.axes
    assert scene.get_title(loc="left") == "a title"
    assert "32 channels" in line.get_title(loc="left")
    assert len(scan.get_lines()) == 3
    x, y = line.get_lines()[0].get_data()
    peak = np.asarray(x)[np.argmax(y)]
    assert peak == pytest.approx(180.0 * 62 / 90 - 90.0)  # beam 62 is to the left
    assert scan.get_xlim()[0] > scan.get_xlim()[1]  # and left is left
    left, right, *_ = image.images[0].get_extent()
    column = (peak - left) / (right - left) * 29
    assert column == pytest.approx(20.5)
    assert image.get_xlim() == scan.get_xlim()
    assert "angle" in image.get_xlabel()


def test_pictures_are_written(drive: Make, world: Callable[..., Any], tmp_path: Path) -> None:
    made = Activations(world(), np.ones((1, 90), np.float32), np.ones((2, 9), np.float32),
                       np.arange(9.0))  # fmt: skip
    for name, save in (
        ("a.png", lambda path: save_trajectories([drive()], path)),
        ("b.png", lambda path: save_worst([Panel(drive())], path)),
        ("c.png", lambda path: save_activations(made, path)),
    ):
        save(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 5_000
        with pytest.raises(OSError):
            save(tmp_path / "away" / name)


def test_long_names_of_places_and_methods_are_not_cut_off(drive: Make) -> None:
    name = "the-third-floor-of-the-west-wing-as-it-was-mapped-in-march-with-all-doors-open"
    outcomes = ("arrived", "collided", "lost", "timeout")
    drives = [drive(f"runs/{name}/{o}", name, outcome=o) for o in outcomes]
    assert words_cut_off(trajectories_figure(drives)) == []
    for count in (1, 2, 4):
        panels = [Panel(each, f"recorded: {name}") for each in drives[:count]]
        assert words_cut_off(worst_figure(panels, f"runs/{name}: the worst of {name}")) == []
