from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from PIL import Image

from lndrl.cli.main import run

PATIENCE = 120.0  # s, for machines with much else to do
ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [0, 0]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""


@pytest.fixture
def room(tmp_path: Path) -> str:
    file = tmp_path / "room.yaml"
    file.write_text(ROOM)
    return str(file)


def test_evaluate_prints_json_alone_on_stdout(room: str, capsys) -> None:
    assert run(["evaluate", "straight", "--scenario", room, "--episodes", "2", "--workers", "0",
                "--json"]) == 0  # fmt: skip
    out, err = capsys.readouterr()
    data = json.loads(out)
    assert (data["planner"], data["scenario"], data["episodes"]) == ("straight", "room", 2)
    assert data["metrics"]["arrival"]["rate"] == 1.0
    assert "straight on room" in err


def test_several_planners_are_compared(room: str, capsys) -> None:
    arguments = ["--scenario", room, "--episodes", "1", "--workers", "0"]
    assert run(["evaluate", "straight", "random", *arguments]) == 0
    out = capsys.readouterr().out
    assert "straight on room: 1 episode," in out and "random on room: 1 episode," in out
    tables, _, following = out.partition("next: ")
    assert tables.count("planner") == 1
    assert following.startswith("lndrl play straight --scenario")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["evaluate", "straight", "--episodes", "0"], "--episodes 0: must be 1 or more"),
        (["evaluate", "straight", "--seed", "-1"], "--seed -1"),
        (["evaluate", "straight", "--workers", "-1"], "--workers -1"),
        (["evaluate", "dwa", "--checkpoint", "best"], "goes with a run folder, and dwa is none"),
        (["play", "dwa", "--out", "a.png", "--checkpoint", "best"], "goes with a run folder"),
        (["evaluate", "runs/none"], "runs/none: no such run folder or weights file"),
        (["evaluate", "straight", "--scenario", "hybird"], "did you mean hybrid?"),
        (["evaluate", "straight", "--scenario", "no.yaml"], "no.yaml: no such file"),
        (["evaluate", "straight", "--localization", "gps"], "perfect"),
        (["play", "straight", "--out", "film.avi"], "must end in .png or .gif or .mp4"),
        (["play", "straight"], "nothing to make; give --out"),
        (["play", "straight", "--rerun", "walk.bag"], "must be a FILE.rrd"),
        (["play", "straight", "--out", "x.gif", "--at", "3"], "--at goes with a .png"),
        (["play", "straight", "--out", "/no/where.png"], "/no does not exist"),
        (["play", "straight", "--out", "x.png", "--episode", "-1"], "--episode -1"),
        (["bench", "wrld"], "'wrld' is unknown"),
        (["bench", "world", "--seconds", "0"], "--seconds 0"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys) -> None:
    assert run(arguments) == 2
    out, err = capsys.readouterr()
    assert sentence in err and len(err.strip().splitlines()) == 1
    assert out == ""


def test_play_draws_the_episode_that_evaluate_counts(room: str, tmp_path: Path, capsys) -> None:
    picture, film = tmp_path / "a.png", tmp_path / "a.gif"
    where = ["--scenario", room, "--seed", "3"]
    assert run(["play", "straight", "--out", str(picture), "--episode", "1", *where]) == 0
    said = capsys.readouterr().out
    arguments = ["--episodes", "2", "--workers", "0", "--json"]
    assert run(["evaluate", "straight", *where, *arguments]) == 0
    record = json.loads(capsys.readouterr().out)["records"][1]
    assert f"{record['outcome']} after {record['time']:.1f} s" in said
    assert f"return {record['episode_return']:.0f}" in said
    with Image.open(picture) as image:
        assert image.width > 500
    short = tmp_path / "short.yaml"
    short.write_text(ROOM.replace("[4, 1, 5, 3]", "[2.2, 1, 2.6, 3]"))
    arguments = ["--scenario", str(short), "--no-panels"]
    assert run(["play", "straight", "--out", str(film), *arguments]) == 0
    with Image.open(film) as image:
        assert getattr(image, "n_frames", 1) > 1


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_to_all_ends_evaluate_and_its_workers(room: str, number: int, code: int) -> None:
    command = [sys.executable, "-m", "lndrl", "evaluate", "random", "--scenario", room,
               "--episodes", "100000", "--workers", "2"]  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as process:
        assert process.stderr is not None
        process.stderr.readline()  # the progress line: workers are about to start
        deadline = time.monotonic() + PATIENCE
        while len(_children(process.pid)) < 3 and time.monotonic() < deadline:
            time.sleep(0.05)
        children = _children(process.pid)
        assert len(children) == 3  # two workers and multiprocessing's resource tracker
        os.killpg(process.pid, number)
        assert process.wait(PATIENCE) == code
        error = process.stderr.read()
        assert "Traceback" not in error and "worker " not in error
        assert "stopped: random on room, " in error
        while any(Path(f"/proc/{pid}").exists() for pid in children):
            assert time.monotonic() < deadline + 2 * PATIENCE
            time.sleep(0.05)


def _children(pid: int) -> list[int]:
    try:
        return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except FileNotFoundError:
        return []


def test_play_at_a_moment_goes_with_a_picture_only(tmp_path, capsys) -> None:
    assert run(["play", "straight", "--out", str(tmp_path / "a.gif"), "--at", "2"]) == 2
    assert "--at" in capsys.readouterr().err
    assert run(["play", "straight", "--out", str(tmp_path / "a.png"), "--at", "2"]) == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000
