"""What is drawn of a moment: the belief, and how it came to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.text import Text

from lndrl.errors import UserError
from lndrl.navigation import WorldSnapshot
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.view.playing import video
from lndrl.view.playing.course import course_of, deviation_ellipse
from lndrl.view.playing.figure import moment_figure
from tests.lndrl.view.playing.walk import walk

Make = Callable[..., WorldSnapshot]


def words_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text)]


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_the_ellipse_is_the_covariance(angle: float) -> None:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = turn @ np.diag([0.09, 0.01]) @ turn.T
    covariance[2, 2] = 7.0
    long, short, found = deviation_ellipse(covariance)
    assert (long, short) == pytest.approx((0.6, 0.2))
    assert math.sin(found - angle) == pytest.approx(0.0, abs=1e-9)


def test_a_course_sums_what_was_paid(world: Make) -> None:
    course = course_of(walk(world, "lost"))
    assert course.paid[-1].tolist() == pytest.approx([6.0, -3.0, 0.0, 0.0, -500.0, -15.0])
    assert course.lost_at == pytest.approx(course.time[-1])
    assert course_of(walk(world, "arrived")).lost_at is None


def test_a_moment_shows_all_of_the_belief(world: Make) -> None:
    moments = walk(world, "lost")
    early = moment_figure(moments, 1)
    ellipses = [e for e in early.axes[0].findobj(Ellipse) if e.width == pytest.approx(0.8)]
    assert len(ellipses) == 1 and ellipses[0].height == pytest.approx(0.4)
    words = words_of(early)
    assert "25%" in words, "the second cluster says how heavy it is"
    assert "60" in words and "framed: taken" in words
    assert {*REWARD_PARTS} <= {*words} and "-5" in words
    assert "lost here" not in words
    last = words_of(moment_figure(moments, 3, course=course_of(moments)))
    assert last.count("lost here") == 2 and "lost at 1.2 s" in last
    arrived = words_of(moment_figure(walk(world, "arrived"), 3))
    assert not any("lost at" in each or "lost here" in each for each in arrived)


def test_heavier_particles_are_larger(world: Make) -> None:
    from lndrl.view.pictures.world import world_figure

    snapshot = world(particles=4)
    shown = replace(snapshot, weights=np.array([0.7, 0.1, 0.1, 0.1]))
    sizes = [
        c.get_sizes().tolist()
        for c in world_figure(shown, close_up=False).axes[0].collections
        if np.shape(c.get_offsets())[0] == 4 and hasattr(c, "get_sizes") and len(c.get_sizes()) == 4
    ]
    assert len(sizes) == 1 and sizes[0][0] == pytest.approx(7 * sizes[0][1])


def test_a_rule_says_so_and_a_start_has_no_action(world: Make) -> None:
    moments = [replace(m, probabilities=np.zeros(0)) for m in walk(world, "arrived")]
    assert "a rule: taken action alone" in words_of(moment_figure(moments, 2))
    assert "none yet" in words_of(moment_figure(moments, 0))


def test_a_video_has_every_picture_and_rests_on_the_last(tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio_ffmpeg")

    def figure(k: int) -> Figure:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        drawn = Figure(figsize=(12, 5.01), facecolor=("red", "blue")[k])
        FigureCanvasAgg(drawn)
        return drawn

    told: list[int] = []
    file = tmp_path / "walk.mp4"
    video.save_mp4(figure, 2, file, fps=10, pixels=240, progress=told.append)
    frames = imageio.read_frames(str(file))
    facts = next(frames)
    pictures = [np.frombuffer(data, np.uint8).reshape(-1, 3).mean(axis=0) for data in frames]
    assert told == [1, 2] and facts["size"] == (240, 100) and facts["codec"] == "h264"
    assert len(pictures) == 2 + round(10 * video.HOLD_LAST)
    assert pictures[0][0] > 200 > 60 > pictures[0][2]
    assert pictures[-1][2] > 200 > 60 > pictures[-1][0]


def test_what_ffmpeg_cannot_do_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video, "ENCODING", ("-c:v", "no-such-codec"))
    figure: Any = lambda k: _figure()  # noqa: E731
    with pytest.raises(UserError, match=r"walk\.mp4: ffmpeg cannot write it \("):
        video.save_mp4(figure, 1, tmp_path / "walk.mp4", pixels=120)
    monkeypatch.setattr(video.shutil, "which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(UserError, match=r'pip install "lndrl\[video\]"'):
        video.save_mp4(figure, 1, tmp_path / "walk.mp4")


def _figure() -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    drawn = Figure(figsize=(12, 5))
    FigureCanvasAgg(drawn)
    return drawn
