from __future__ import annotations

import io
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.live import Live

from lndrl import kernels
from lndrl.cli.main import run
from lndrl.policy.shipped import WALK_FILE
from lndrl.view.recorded import recorded_walk

demo_module = import_module("lndrl.cli.evaluation.demo")

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [1, 1], routes: [{start: [3, 3, 4, 3.5], goal: [3, 3, 4, 3.5]}]}
robot: [{start: [1, 1, 2, 3], goal: [2.2, 1, 2.6, 3]}]
"""


@pytest.fixture
def room(tmp_path: Path) -> str:
    file = tmp_path / "room.yaml"
    file.write_text(ROOM)
    return str(file)


def test_without_a_terminal_it_tells_the_walk_in_lines(room: str, capsys) -> None:
    assert run(["demo", "--scenario", room]) == 0  # kernels that are compiled tell no first line
    capsys.readouterr()
    assert run(["demo", "--scenario", room]) == 0
    out, err = capsys.readouterr()
    *lines, end, following = out.splitlines()
    assert following.startswith("next: lndrl train")
    assert re.match(
        r"  0\.0 s, +\d\.\d m to the goal, \d (person|people) within 3 m, belief", lines[0]
    )
    assert all(len(line) <= 80 for line in lines)
    assert re.match(r"(arrived|touched|got lost|ran out of time).* after \d+\.\d s", end)
    assert "loading the policy and its world" in err


def test_on_a_terminal_every_step_is_a_picture(
    room: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    drawn = io.StringIO()

    def console(**options: object) -> Console:
        return Console(
            file=drawn, force_terminal=True, width=80, height=24, color_system="truecolor",
            _environ={},
        )  # fmt: skip

    monkeypatch.setattr("rich.console.Console", console)
    monkeypatch.setattr(demo_module, "SHOWN_EVERY", 0.0)
    monkeypatch.setattr("lndrl.view.progress.Console", Console)
    assert run(["demo", "--scenario", room, "--shield"]) == 0
    assert "▀" in drawn.getvalue() and "where it believes to be" in drawn.getvalue()
    assert drawn.getvalue().count("m to the goal") > 2
    assert " after " in capsys.readouterr().out


def test_no_line_is_drawn_beside_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    moments, _ = recorded_walk(WALK_FILE)
    lines: list[str] = []

    class Line:
        def __enter__(self) -> Line:
            lines.append("begun")
            return self

        def __exit__(self, *_: object) -> None:
            lines.append("over")

        def update(self, words: str) -> None:
            lines.append(words)

    @contextmanager
    def play(words: Callable[[], str]) -> Iterator[None]:
        yield

    monkeypatch.setattr("lndrl.view.progress.StatusLine", Line)
    with demo_module._told_what_is_awaited(lambda _: lines.append("picture"), play) as show:
        show(moments[0])
    assert lines == ["begun", "loading the policy and its world", "over", "picture"]


def test_a_recorded_walk_is_played_while_kernels_compile_and_no_longer() -> None:
    told: list[str] = []
    moments, _ = recorded_walk(WALK_FILE)

    @contextmanager
    def play(words: Callable[[], str]) -> Iterator[None]:
        told.append("begun")
        yield
        told.append(f"over at {words()}")

    with demo_module._told_what_is_awaited(lambda each: told.append(f"{each.steps}"), play) as show:
        kernels.tell(3, 148)
        show(moments[0])  # the first step is still awaited
        kernels.tell(4, 148)
        show(moments[1])
        show(moments[2])
    assert told == ["begun", "over at compiling kernels, 4 of 148 ready", "1", "2"]


def test_it_says_that_it_is_recorded_and_leaves_no_thread() -> None:
    drawn = io.StringIO()
    console = Console(file=drawn, force_terminal=True, width=80, height=24, _environ={})
    with Live(console=console, auto_refresh=False) as live:
        with demo_module._Screen(console, live).recorded(lambda: "3 of 148"):
            deadline = time.monotonic() + 60
            while "recorded; yours follows" not in drawn.getvalue():
                assert time.monotonic() < deadline
                time.sleep(0.01)
        assert not any(thread.name == "lndrl-demo" for thread in threading.enumerate())


def test_one_seed_is_one_walk_and_another_is_another(room: str, capsys) -> None:
    ends = []
    for seed in ("1", "1", "2"):
        assert run(["demo", "--scenario", room, "--seed", seed]) == 0
        ends.append(capsys.readouterr().out)
    assert ends[0] == ends[1] != ends[2]


def test_out_is_a_film_of_the_whole_walk(
    room: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    given: list[Any] = []

    def save_gif(snapshots: list[Any], path: Path, progress: Callable[[int], None]) -> None:
        given.extend(snapshots)
        path.write_bytes(b"GIF")

    # How it is drawn has its own tests, and a walk in full takes a while.
    monkeypatch.setattr("lndrl.view.pictures.film.save_gif", save_gif)
    film = tmp_path / "walk.gif"
    assert run(["demo", "--scenario", room, "--out", str(film)]) == 0
    assert capsys.readouterr().out.startswith(f"{film}: ") and film.read_bytes() == b"GIF"
    assert [each.steps for each in given] == list(range(len(given))) and given[-1].outcome


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--out", "walk.png"], "must end in .gif"),
        (["--seed", "-1"], "--seed -1: must be 0 or more"),
        (["--scenario", "hybird"], "did you mean hybrid?"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys) -> None:
    assert run(["demo", *arguments]) == 2
    err = capsys.readouterr().err
    assert sentence in err and "Traceback" not in err
