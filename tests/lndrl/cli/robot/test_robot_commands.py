"""drive, robot-sim and replay: what they refuse before anything moves, and one whole rehearsal."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lndrl.cli.main import run
from lndrl.transport.zenoh.session import free_endpoint

ROOM = """
name: room
size: [9, 6]
pedestrians: {count: [0, 0]}
obstacles: [{circle: [6.5, 1.2, 0.3]}, {box: [1.0, 4.9, 2.2, 5.4]}]
robot: [{start: [1, 2, 2, 3], goal: [5, 2, 6, 3]}]
"""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("drive shipped --goal 1", "--goal 1: must be 2 numbers, e.g. --goal 4.0,1.5"),
        ("drive shipped --goal 1,nan", "--goal 1,nan: must be 2 numbers"),
        ("drive shipped --pose 1,2", "--pose 1,2: must be 3 numbers"),
        ("drive shipped --scanner 1,2", "--scanner 1,2: must be 3 numbers"),
        ("drive shipped --stale 0", "--stale 0: must be 0.05 to 5 s"),
        ("drive shipped --max-speed 0", "limit speed 0: must be above 0"),
        ("drive shipped --enable-button 1", "--enable-button 1 goes with --enable-topic"),
        ("drive shipped --enable-topic joy", "topic 'joy': must be a full name like /scan"),
        ("drive shipped --connect 1.2.3.4", "--connect 1.2.3.4: not an endpoint"),
        ("drive shipped --topic scan", "--topic scan: must be FOR=NAME"),
        ("drive shipped --topic lidar=/scan", "topic lidar: there is none for that; known: scan"),
        ("drive nowhere", "nowhere: no such run folder or weights file"),
        ("drive straight --robot turtelbot2", "did you mean turtlebot2?"),
        ("drive straight --guard-set people=1", "--guard-set"),
        ("drive straight --no-guard --guard-set body=1", "which --no-guard turns off"),
        ("robot-sim --robot turtelbot2", "did you mean turtlebot2?"),
        ("replay x.mcap --robot turtelbot2", "did you mean turtlebot2?"),
        ("drive straight --filter bset", "--filter bset: is unknown; known: paper, best"),
        ("robot-sim --mute lidar:1:2", "--mute lidar:1:2: nothing of that name"),
        ("robot-sim --mute scan:1", "--mute 1: must be 2 numbers"),
        ("robot-sim --loss 2", "loss 2: must be a share"),
        ("robot-sim --pace 0", "pace 0: must be"),
        ("robot-sim --scenario nowhere", "nowhere"),
        ("robot-sim --listen tcp/0.0.0.0:7447", "open to other machines and not protected"),
        ("replay nothing.mcap", "nothing.mcap: is no bag of ROS 2 that can be read"),
        ("replay x.mcap --out x.txt", "--out x.txt: must end in .png"),
        ("replay x.mcap --csv x.txt", "--csv x.txt: must end in .csv"),
    ],
)
def test_what_is_refused(
    arguments: str, words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert run(arguments.split()) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert words in said


def test_nobody_answers(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["drive", "straight", "--connect", free_endpoint(), "--timeout", "0.3"]) == 2
    assert "no robot answers at tcp/127.0.0.1:" in capsys.readouterr().err


def start(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "lndrl", *arguments], cwd=cwd, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONFAULTHANDLER": "1"},
    )  # fmt: skip


def ended(process: subprocess.Popen[str], seconds: float) -> tuple[str, str]:
    """What it says until its end; one that hangs tells where its threads are."""
    try:
        return process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)  # faulthandler's
        pytest.fail(f"still running after {seconds:g} s:\n{process.communicate()[1]}")


def test_a_rehearsal_from_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ROOM)
    endpoint = free_endpoint()
    robot = start("robot-sim", "--scenario", "room.yaml", "--listen", endpoint, "--fast", "--json",
                  "--episodes", "2", "--robot", "turtlebot2", cwd=tmp_path)  # fmt: skip
    drive = start("drive", "straight", "--connect", endpoint, "--timeout", "120", "--plain",
                  "--record", "drive.mcap", "--robot", "turtlebot2", "--json",
                  cwd=tmp_path)  # fmt: skip
    try:
        out, err = robot.communicate(timeout=240)
        assert robot.returncode == 0, err
        records = [json.loads(line) for line in out.splitlines()]
        assert [each["outcome"] for each in records] == ["arrived", "arrived"]
        time.sleep(0.5)
        drive.send_signal(signal.SIGINT)
        out, err = ended(drive, 60.0)
    finally:
        robot.kill()
        drive.kill()
    assert drive.returncode == 130 and "Traceback" not in err
    result = json.loads(out)
    assert result["guard"] and 0.0 <= result["guarded"] < 0.5
    assert any("sees nothing nearer than 0.2 m" in each for each in result["differences"])
    assert "guard: on; people walk up to 0.5 m/s" in err and "robot turtlebot2: " in err
    assert result["arrivals"] == 2 and result["recorded_messages"] > 300
    assert result["latency_milliseconds"]["median"] > 0.0
    again = start("replay", "drive.mcap", "--policy", "straight", "--out", "belief.png", "--csv",
                  "belief.csv", "--robot", "turtlebot2", "--json", cwd=tmp_path)  # fmt: skip
    out, err = again.communicate(timeout=240)
    assert again.returncode == 0, err
    replayed = json.loads(out)
    assert replayed["beliefs"] > 50 and replayed["off_mean"] < 0.3
    assert replayed["reference"] == "/lndrl/pose"
    assert replayed["guarded"] == pytest.approx(result["guarded"], abs=0.15)
    told = start("replay", "drive.mcap", "--policy", "straight", cwd=tmp_path)
    out, err = told.communicate(timeout=240)
    assert told.returncode == 0, err
    assert out.splitlines()[-1] == (
        "next: lndrl replay drive.mcap --policy straight --out replay.png  # as a picture"
    )
    assert (tmp_path / "belief.png").stat().st_size > 5000
    assert len((tmp_path / "belief.csv").read_text().splitlines()) == replayed["beliefs"] + 1
