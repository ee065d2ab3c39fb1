"""What is shown of a drive and of a replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from lndrl.planners import GuardConfig
from lndrl.robot.bags import Moment, Replay
from lndrl.robot.driving.assembly import DriveOptions
from lndrl.view.robots.drive import drive_line, drive_screen
from lndrl.view.robots.replay import replay_figure, replay_table, save_replay
from tests.lndrl.robot.driving.test_guarding import somebody
from tests.lndrl.robot.rig import Rig


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig(planner="shipped").begin().tick(9)


def printed(rig: Rig, width: int, height: int, colours: bool = True) -> list[str]:
    console = Console(width=width, height=height, force_terminal=True, color_system="truecolor")
    view = rig.driver.view(rig.now)
    with console.capture() as captured:
        console.print(drive_screen(view, "shipped drives", 0.0042, width, height, colours))
    console = Console(width=width)
    return [console.render_str("").plain, *captured.get().splitlines()]


@pytest.mark.parametrize(("width", "height"), [(110, 40), (80, 24), (60, 20), (20, 6)])
def test_it_fits_every_terminal(rig: Rig, width: int, height: int) -> None:
    from rich.text import Text

    lines = printed(rig, width, height)[1:]
    assert len(lines) <= height
    assert all(Text.from_ansi(line).cell_len <= width for line in lines)


def test_it_shows_where_and_what_it_thinks_of(rig: Rig) -> None:
    text = "\n".join(printed(rig, 110, 40, colours=False))
    for words in (
        "driving",
        "m/s",
        "what it thinks of",
        "most:",
        "answers in 4.2 ms",
        "to the goal",
    ):
        assert words in text
    for glyph in "#'eGoR":
        assert glyph in text


def test_it_shows_what_stops_it() -> None:
    rig = Rig().begin().tick(6).quiet(0.6)
    text = "\n".join(printed(rig, 110, 30, colours=False))
    assert "standing scan_stale: the last scan is" in text and "also odometry_stale" in text
    assert "scan_stale: the last scan is" in drive_line(rig.driver.view(rig.now))


def test_it_shows_the_guard_and_how_well_the_belief_stands(rig: Rig) -> None:
    text = "\n".join(printed(rig, 110, 40, colours=False))
    assert "no guard" in text
    assert "map explains" in text and "2nd place" in text and "echoes" in text
    guarded = Rig(DriveOptions(guard=GuardConfig())).begin().tick(14)
    guarded.tick(12, somebody(0.6))
    text = "\n".join(printed(guarded, 110, 40, colours=False))
    assert "guard on" in text
    assert "standing guarded: what may move is 0." in text
    turning = replace(guarded.driver.view(guarded.now), stops=(), guarded="what may move is near")
    console = Console(width=110, height=40)
    with console.capture() as captured:
        console.print(drive_screen(turning, "x", None, 110, 40, False))
    assert "held back by the guard: what may move is near" in captured.get()


def test_it_says_where_the_scanner_does_not_look() -> None:
    def narrow(purpose: str, content: Any) -> Any:
        if purpose != "scan":
            return content
        first = content.angle_min + 120 * content.angle_increment
        return replace(content, angle_min=first, ranges=content.ranges[120:600])

    rig = Rig().begin().tick(4, narrow)
    assert "blind in 33 % of its view" in "\n".join(printed(rig, 110, 30, colours=False))


def test_it_shows_something_before_anything_has_come() -> None:
    rig = Rig()
    rig.driver.watch(rig.now)
    text = "\n".join(printed(rig, 90, 20, colours=False))
    assert "no_scan: no scan has come" in text and "no pose yet" in text


def result_of(moments: int, reference: bool) -> Replay:
    found = Replay(12.0, scans=moments)
    for k in range(moments):
        pose = np.array([0.1 * k, 0.05 * k, 0.1])
        found.moments.append(
            Moment(0.1 * k, pose, 0.1, 0.01, 0.8, 150.0, 0.05 if reference else np.nan, 0.01,
                   (0.2, 0.0), (0.2, 0.0), ("scan_stale",) if k % 3 == 0 else ())
        )  # fmt: skip
    if reference:
        found.reference_topic = "/amcl_pose"
        found.reference = np.column_stack([np.arange(5.0), np.zeros((5, 3))])
    return found


@pytest.mark.parametrize(("moments", "reference"), [(30, True), (30, False), (0, False)])
def test_a_replay_has_a_table_and_a_picture(moments: int, reference: bool, tmp_path: Path) -> None:
    result = result_of(moments, reference)
    console = Console(width=100)
    with console.capture() as captured:
        console.print(replay_table("bag", result.summary()))
    assert ("from /amcl_pose" in captured.get()) == reference
    figure = replay_figure(result, "bag")
    assert len(figure.axes) == 3
    save_replay(result, "bag", tmp_path / "bag.png")
    assert (tmp_path / "bag.png").stat().st_size > 5000
