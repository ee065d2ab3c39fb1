"""Laser logs of real robots: reading them, the map from their scans, the command."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from lndrl.cli.main import run
from lndrl.errors import UserError
from lndrl.evaluation.localization import LOGS_BEGIN, LOGS_END, load_carmen, survey
from lndrl.localization import compose

SCANS = 40
WIDTH, HEIGHT = 8.0, 6.0


def in_the_room(pose: np.ndarray, count: int) -> np.ndarray:
    """Ranges of ``count`` beams over the front half in a room of WIDTH x HEIGHT m."""
    bearing = -0.5 * math.pi + math.pi / (count - count % 2) * np.arange(count) + pose[2]
    with np.errstate(divide="ignore"):
        x = np.where(np.cos(bearing) > 0, WIDTH - pose[0], -pose[0]) / np.cos(bearing)
        y = np.where(np.sin(bearing) > 0, HEIGHT - pose[1], -pose[1]) / np.sin(bearing)
    return np.minimum(x, y)


def text_of(kind: str, beams: int = 181) -> tuple[str, np.ndarray, np.ndarray]:
    """A log, its true poses, and the odometer's from the first one."""
    truth, odometry = [np.array([2.0, 2.0, 0.1])], [np.zeros(3)]
    lines = ["# message formats defined: ODOM FLASER", "PARAM robot_frontlaser_offset 0.0 nohost 0"]
    chained = truth[0]
    for k in range(SCANS):
        if k:
            for _ in range(3):  # readings between two scans; the wheels see 3 % too much
                move = np.array([0.04, 0.0, 0.05])
                truth.append(compose(truth[-1], move))
                odometry.append(compose(odometry[-1], 1.03 * move))
                chained = compose(chained, 1.03 * move)
                raw = compose([7.0, -3.0, 1.0], odometry[-1])
                told = chained if kind == "chained" else raw
                lines.append("ODOM " + " ".join(f"{v:.6f}" for v in told) + " 0 0 0 1 pc 1")
        pose = truth[-1]
        ranges = " ".join(f"{r:.3f}" for r in in_the_room(pose, beams))
        raw = compose([7.0, -3.0, 1.0], odometry[-1])
        second = pose if kind == "chained" else raw
        first = raw if kind == "raw" else pose
        poses = " ".join(f"{v:.6f}" for v in (*first, *second))
        if kind == "robotlaser":
            head = f"ROBOTLASER1 0 {-math.pi / 2} {math.pi} {math.pi / 180} 50.0 0.01 0 {beams}"
            lines.append(f"{head} {ranges} 0 {poses} 0 0 0 0 0 1.0 pc 1.0")
        else:
            lines.append(f"FLASER {beams} {ranges} {poses} 1.0 pc 1.0")
        chained = pose
    return "\n".join(lines) + "\n", np.array(truth[::3]), np.array(odometry[::3])


@pytest.mark.parametrize("kind", ["chained", "corrected", "robotlaser"])
def test_truth_and_raw_odometry_of_each_kind_of_log(tmp_path: Path, kind: str) -> None:
    text, truth, odometry = text_of(kind)
    path = tmp_path / "place-corrected.log.gz"
    path.write_bytes(gzip.compress(text.encode()))
    log = load_carmen(path)
    assert log.name == "place"
    assert log.truth == pytest.approx(truth, abs=1e-5)
    assert log.odometry[:, :2] == pytest.approx(odometry[:, :2], abs=1e-3)
    assert np.cos(log.odometry[:, 2] - odometry[:, 2]) == pytest.approx(1.0)
    assert log.ranges.shape == (SCANS, 181)
    assert log.bearings[[0, 90, 180]] == pytest.approx([-math.pi / 2, 0.0, math.pi / 2], abs=1e-5)
    assert log.farthest == (50.0 if kind == "robotlaser" else math.inf)
    assert log.length == pytest.approx(0.12 * (SCANS - 1), rel=0.01)


def test_angles_of_180_beams_end_a_step_short(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text(text_of("chained", beams=180)[0])
    assert load_carmen(path).bearings[-1] == pytest.approx(math.pi / 2 - math.pi / 180, abs=1e-5)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "0 scans"),
        ("FLASER 3 1 2\n", "bad.log, line 1: no whole FLASER message"),
        ("FLASER x 1 2\n", "line 1: no whole FLASER message"),
        ("ODOM 0 nan 0 0\n", "line 1: no whole ODOM message"),
        ("FLASER 2 1 2 0 0 0 0 0 0 1 pc 1\n" * 3, "3 scans"),
        (text_of("raw")[0], "only a corrected log"),
        (
            "".join(li + "\n" for li in text_of("chained")[0].split("\n") if li[:4] != "ODOM"),
            "its ODOM lines tell 0 of 5 m",
        ),
    ],
)
def test_bad_logs_say_what_is_wrong(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "bad.log"
    path.write_text(text)
    with pytest.raises(UserError, match=sentence):
        load_carmen(path)


def test_a_broken_archive_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "cut.log.gz"
    path.write_bytes(gzip.compress(b"ODOM 0 0 0 0\n" * 2000)[:40])
    with pytest.raises(UserError, match=r"cut\.log\.gz: cannot be read"):
        load_carmen(path)
    path.write_text("not packed")
    with pytest.raises(UserError, match="cannot be read"):
        load_carmen(path)


def test_the_map_is_the_room(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text(text_of("chained")[0])
    log = load_carmen(path)
    grid = survey(log.truth, log.ranges, log.bearings, log.farthest)
    rows, columns = np.nonzero(grid.mapped)
    x = grid.origin[0] + (columns + 0.5) * grid.resolution
    y = grid.origin[1] + (rows + 0.5) * grid.resolution
    to_wall = np.minimum.reduce([abs(x), abs(x - WIDTH), abs(y), abs(y - HEIGHT)])
    assert len(x) > 150 and to_wall.max() < 0.1
    row, column = grid.index(4.0, 3.0)
    assert grid.free[row, column]
    row, column = grid.index(-0.5, -0.5)  # behind the wall nobody looked
    assert grid.unknown is not None and grid.unknown[row, column]


def test_the_command_on_logs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, few, out = tmp_path / "hall.log", tmp_path / "few.yaml", tmp_path / "page.md"
    path.write_text(text_of("chained")[0])
    few.write_text("preset: robot\nmin_particles: 200\nmax_particles: 400\n")
    out.write_text(f"# Before\n\n{LOGS_BEGIN}\nfigures of before\n{LOGS_END}\n\nAfter.\n")
    given = ["localization", "--logs", str(path), "--settings", str(few), "--seeds", "2",
             "--workers", "0"]  # fmt: skip
    assert run([*given, "--json", "--out", str(out)]) == 0
    printed, said = capsys.readouterr()
    data = json.loads(printed)
    assert len(data["outcomes"]) == 4 and "4 of 4 replays" in said
    heard = {o["heard"]: o for o in data["outcomes"] if o["seed"] == 1}
    assert heard["every scan"]["scans"] == SCANS and heard["unseen scans"]["scans"] == SCANS // 2
    for outcome in heard.values():
        assert not outcome["lost"] and outcome["median"] < 0.1
    text = out.read_text()
    assert "| hall | 5 | 40 | few | 0/2 |" in text and "of before" not in text
    assert text.startswith("# Before") and text.endswith("After.\n")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--logs", "none.log"], "none.log is no file"),
        (["--logs", ","], "--logs"),
        (["--logs", __file__, "--seeds", "0"], "--seeds 0"),
        (["--logs", __file__, "--workers", "0"], "0 scans"),
        (["--logs", f"{__file__},{__file__}"], "one log is named twice"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys) -> None:
    assert run(["localization", "--settings", "paper", *arguments]) == 2
    out, err = capsys.readouterr()
    assert sentence in err.strip().splitlines()[-1] and "Traceback" not in err and out == ""
