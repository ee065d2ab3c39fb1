"""Ctrl-C in commands that take long: one line says what it leaves and how to go on."""

from __future__ import annotations

import shlex
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lndrl.bench import report
from lndrl.cli.main import run
from lndrl.evaluation.benchmark import ResultsFolder
from lndrl.view import progress

ROOM = """
name: room
size: [7, 5]
pedestrians: {count: [1, 1], routes: [{start: [1, 4, 2, 4.5], goal: [5, 4, 6, 4.5]}]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""
BENCH = "scenarios: [room.yaml]\nmethods:\n  random: {planner: random}\n"
CALIBRATION = "seed: 3\nscenarios: [sparse]\nvariants: {as_is: {why: nothing changes}}\n"
FEW = "min_particles: 100\nmax_particles: 200\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in (("room", ROOM), ("bench", BENCH), ("few", FEW)):
        (tmp_path / f"{name}.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ctrl_c(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Sends SIGINT when a bar has advanced as often as asked."""
    bar = progress.progress_bar

    def after(count: int) -> None:
        @contextmanager
        def interrupted(*arguments: Any, **options: Any) -> Iterator[progress.Advance]:
            left = count
            with bar(*arguments, **options) as advance:

                def counting(*given: Any, **named: Any) -> None:
                    nonlocal left
                    advance(*given, **named)
                    left -= 1
                    if not left:
                        signal.raise_signal(signal.SIGINT)

                yield counting

        monkeypatch.setattr(progress, "progress_bar", interrupted)

    return after


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Callable[[list[str]], tuple[str, str]]:
    """Runs a command that is interrupted; (stdout, the last line of stderr)."""

    def call(command: list[str]) -> tuple[str, str]:
        assert run(command) == 130
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return " ".join(out.split()), err.splitlines()[-1]

    return call


def test_evaluate_shows_what_has_ended(here: Path, ctrl_c, told) -> None:
    command = "evaluate straight random --scenario room.yaml --episodes 8 --workers 0".split()
    ctrl_c(3)
    out, line = told(command)
    assert "UNFINISHED, 3 of 8 episodes, the quickest: straight on room: 3 episodes" in out
    assert "arrival rate" in out and "random" not in out
    begin_again = f"begin again with: {shlex.join(['lndrl', *command])}"
    assert line == (
        "stopped: straight on room, 3 of 8 episodes have ended and are not kept; " + begin_again
    )
    out, line = told([*command, "--json"])
    assert out == "", "half a result is none"
    assert line.endswith("--json")


def test_evaluate_shows_planners_that_are_done_in_full(
    here: Path, ctrl_c, told, monkeypatch
) -> None:
    whole = progress.progress_bar
    ctrl_c(1)
    command = "evaluate straight random --scenario room.yaml --workers 0 --episodes 8".split()
    bar, bars = progress.progress_bar, iter((True, False))
    # Each planner has a bar of its own; only the second one is interrupted.
    monkeypatch.setattr(
        progress,
        "progress_bar",
        lambda *given: (whole if next(bars) else bar)(*given),
    )
    out, line = told(command)
    assert "straight on room: 8 episodes" in out
    assert "UNFINISHED, 1 of 8 episodes, the quickest: random on room" in out
    assert line.startswith("stopped: random on room, 1 of 8 episodes have ended")


def test_benchmark_goes_on(here: Path, ctrl_c, told, monkeypatch, capsys) -> None:
    command = "benchmark --spec bench.yaml --episodes 16 --workers 0 --name a".split()
    ctrl_c(9)
    _, line = told(command)
    assert line == (
        "stopped: 9 of 16 missing episodes have ended and are kept in results/a; "
        f"go on with: {shlex.join(['lndrl', *command])}"
    )
    monkeypatch.undo()
    monkeypatch.chdir(here)
    assert run(shlex.split(line.partition("go on with: lndrl ")[2])) == 0
    assert "7 of 7 episodes" in capsys.readouterr().err, "nothing that has ended is run again"


def test_a_results_folder_has_one_command_at_a_time(here: Path, capsys) -> None:
    with ResultsFolder(Path("results/a")).locked():
        assert run("benchmark --spec bench.yaml --episodes 8 --workers 0 --name a".split()) == 2
        assert run("calibrate --episodes 1 --workers 0 --name a".split()) == 2
    err = capsys.readouterr().err
    assert err.count("results/a: a test is still at work there, process ") == 2
    assert err.count("wait for it or choose another --name") == 2


def test_calibrate_goes_on(here: Path, ctrl_c, told) -> None:
    ctrl_c(1)
    Path("variants.yaml").write_text(CALIBRATION)
    command = "calibrate variants.yaml --episodes 8 --workers 0".split()
    _, line = told(command)
    assert "missing episodes have ended and are kept in results/calibration; go on with:" in line
    assert line.endswith(shlex.join(["lndrl", *command]))


def test_localization_begins_again(here: Path, ctrl_c, told) -> None:
    ctrl_c(1)
    command = "localization --scenarios room.yaml --settings few.yaml --seeds 2".split()
    command += "--pedestrians 0 --updates 60 --workers 0 --out loc.md".split()
    _, line = told(command)
    assert line == (
        "stopped: 1 of 2 replays have ended and are not kept; "
        f"begin again with: {shlex.join(['lndrl', *command])}"
    )
    assert not Path("loc.md").exists()


def test_returns_begin_again(here: Path, ctrl_c, told) -> None:
    ctrl_c(3)
    out, line = told(
        "returns straight random --scenario room.yaml --episodes 8 --workers 0".split()
    )
    assert out == ""
    assert line == (
        "stopped: 3 of 16 episodes have ended and are not kept; begin again with: "
        "lndrl returns straight random --scenario room.yaml --episodes 8 --workers 0"
    )


def test_lost_begins_again(here: Path, ctrl_c, told) -> None:
    ctrl_c(3)
    command = "lost random --scenario room.yaml --episodes 8 --workers 0 --out a.png".split()
    out, line = told(command)
    assert out == "" and not Path("a.png").exists()
    assert line.startswith("stopped: 3 of 8 episodes have ended, ")
    assert line.endswith(
        f" of them lost, and are not kept; begin again with: {shlex.join(['lndrl', *command])}"
    )


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("figures trajectories --methods random --scenario room.yaml --spec bench.yaml", "picture"),
        ("play straight --scenario room.yaml --out a.gif", "whole picture"),
    ],
)
def test_pictures_are_drawn_anew(here: Path, ctrl_c, told, command: str, words: str) -> None:
    ctrl_c(1)
    _, line = told(command.split())
    assert line == f"stopped: no {words} was written; begin again with: lndrl {command}"
    assert not list(here.glob("*.gif")) + list(here.glob("*.png"))


@pytest.mark.parametrize("json", [[], ["--json"]])
def test_bench_names_what_is_left(monkeypatch, told, json: list[str]) -> None:
    names = list(report.BENCHMARKS)

    def measure(name: str, seconds: float, device: str | None) -> dict[str, Any]:
        if name == names[2]:
            signal.raise_signal(signal.SIGINT)
        return {"figure": 1.0}

    monkeypatch.setattr(report, "measure", measure)
    out, line = told(["bench", "all", *json])
    shown = "printed nothing" if json else f"showed {names[0]}, {names[1]}"
    assert line.startswith(f"stopped: {shown}; not measured: {names[2]}, {names[3]}, ")
    assert line.endswith(f"; begin again with: {shlex.join(['lndrl', 'bench', 'all', *json])}")
    assert bool(out) != bool(json)
