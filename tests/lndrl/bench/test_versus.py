"""A build beside an older one: taken out of a repository, measured in turns, compared by ratio."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lndrl.bench import versus
from lndrl.bench.versus import builds, turns
from lndrl.cli.main import run
from lndrl.errors import UserError

PATIENCE = 600.0  # s, for machines with much else to do

BUILD = """
import json, os, sys
open(os.environ["TURNS"], "a").write(f"{RATE} {' '.join(sys.argv[1:])} {os.getpid()}\\n")
if RATE == 13:
    sys.exit("lndrl: no luck today")
if RATE == 14:
    import time
    time.sleep(600)
print(json.dumps({"steps_per_second": {"hybrid": RATE, "corridor": 2.0 * RATE}}))
"""


def git(repository: Path, *arguments: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    command = ["git", "-C", str(repository), *who, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def write(repository: Path, rate: int, first_world: str | None = None) -> str:
    """Commit a program that is ``rate`` fast; returns the commit."""
    package = repository / "lndrl"
    (package / "bench").mkdir(parents=True, exist_ok=True)
    (package / "bench/__init__.py").write_text("")
    (package / "__init__.py").write_text("")
    (package / "__main__.py").write_text(f"RATE = {rate}\n{BUILD}")
    if first_world is not None:
        (repository / "configs").mkdir(exist_ok=True)
        (repository / "configs/benchmark-v1.yaml").write_text(first_world)
    git(repository, "add", "-A")
    git(repository, "commit", "-qm", f"Be {rate} fast")
    return git(repository, "rev-parse", "HEAD")


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository that this program seems to run from, empty."""
    place = tmp_path / "repository"
    place.mkdir()
    git(place, "init", "-q")
    monkeypatch.setattr(builds, "ROOT", place)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("TURNS", str(tmp_path / "turns"))
    return place


def test_both_take_turns_and_every_round_has_a_ratio(repository: Path, tmp_path: Path) -> None:
    old = write(repository, 4)
    write(repository, 6, first_world="set: [world.tick=0.1]")
    said: list[str] = []
    other = versus.prepare(old[:9])
    figures = versus.compare("world", other, 2.0, 3, said.append)
    assert figures["steps_per_second hybrid"] == {
        "own": 6.0, "other": 4.0, "ratio": 1.5, "ratio_least": 1.5, "ratio_most": 1.5,
    }  # fmt: skip
    assert figures["steps_per_second corridor"]["own"] == 12.0
    turns = [line.split() for line in (tmp_path / "turns").read_text().splitlines()]
    assert [int(turn[0]) for turn in turns] == [6, 4, 4, 6, 6, 4, 4, 6]
    assert all(turn[1:4] == ["bench", "world", "--json"] for turn in turns)
    assert all(turn[5] == "2" for turn in turns[2:])
    assert said[-1] == "round 3 of 3: this program"


def test_beside_the_first_world_this_one_is_like_it(repository: Path, tmp_path: Path) -> None:
    old = write(repository, 4)
    newer = write(repository, 6, first_world="set: [world.tick=0.1]")
    first = versus.prepare(old)
    assert "world.ticks_per_step=4" in first.settings
    assert versus.prepare(newer).settings == ()
    versus.compare("world", first, 1.0, 1, lambda _: None)
    turns = (tmp_path / "turns").read_text().splitlines()
    assert all(("--set world.tick=0.1" in turn) == turn.startswith("6 ") for turn in turns)


def test_a_build_is_taken_out_once(repository: Path) -> None:
    old = write(repository, 4)
    folder = versus.prepare(old).folder
    before = folder.stat().st_mtime_ns
    assert versus.prepare(old).folder == folder and folder.stat().st_mtime_ns == before
    assert not (folder / ".git").exists()


def test_ratios_are_of_rounds() -> None:
    values = {"own": [2.0, 6.0, 4.0], "other": [2.0, 2.0, 2.0]}
    assert turns._ratio(values) == {
        "own": 4.0, "other": 2.0, "ratio": 2.0, "ratio_least": 1.0, "ratio_most": 3.0,
    }  # fmt: skip


def test_a_build_that_fails_is_named_with_what_it_said(repository: Path) -> None:
    old = write(repository, 13)
    write(repository, 6)
    with pytest.raises(UserError, match=rf"world of {old[:12]} failed: lndrl: no luck today"):
        versus.compare("world", versus.prepare(old), 1.0, 1, lambda _: None)


def test_what_cannot_be_compared_is_refused(repository: Path) -> None:
    old = write(repository, 4)
    with pytest.raises(UserError, match="--vs 1234abc: not a commit of"):
        versus.prepare("1234abc")
    with pytest.raises(UserError, match="--vs compares world, policy, learner, train, not amcl"):
        versus.compare("amcl", versus.prepare(old), 1.0, 1, lambda _: None)
    git(repository, "rm", "-rq", "lndrl/bench")
    git(repository, "commit", "-qm", "Measure nothing")
    with pytest.raises(UserError, match="--vs HEAD: that build has no lndrl bench"):
        versus.prepare("HEAD")


def test_outside_a_repository_the_sentence_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(builds, "ROOT", tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    with pytest.raises(UserError, match="is no git repository; run it from a clone"):
        versus.prepare("HEAD")


def test_an_interrupt_leaves_no_process(repository: Path, tmp_path: Path) -> None:
    old = write(repository, 14)
    code = (
        "import pathlib; from lndrl.bench import versus; from lndrl.bench.versus import builds\n"
        f"builds.ROOT = pathlib.Path({str(repository)!r})\n"
        f"versus.compare('world', versus.prepare({old!r}), 1.0, 1, print)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(Path(versus.__file__).resolve().parents[3])},
        stderr=subprocess.PIPE,
        text=True,
    )
    turns = tmp_path / "turns"
    deadline = time.monotonic() + PATIENCE
    while not turns.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(2)
    process.communicate(timeout=PATIENCE)
    # By number: other tests may measure builds on this machine, too.
    measured = int(turns.read_text().split()[-1])
    with pytest.raises(ProcessLookupError):
        os.kill(measured, 0)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["world", "--vs", "HEAD", "--profile"], "--profile goes with train"),
        (["train", "--vs", "HEAD", "--profile"], "--vs compares two builds on the CPU"),
        (
            ["amcl", "--set", "seed=2"],
            "--set goes with world, policy, learner, ranks, train, memory, not",
        ),
        (["world", "--vs", "HEAD", "--seconds", "0"], "--seconds 0: must be above 0"),
    ],
)
def test_options_that_do_not_go_together(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["bench", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_settings_reach_what_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    tiny = ["network.map_channels=[4,4,8]", "network.features=16", "network.goal_features=8"]
    settings = ["ppo.minibatch_size=64", "ppo.batch_size=256", *tiny]
    options = ["--seconds", "0.01", *(part for each in settings for part in ("--set", each))]
    assert run(["bench", "learner", "--json", *options]) == 0
    assert json.loads(capsys.readouterr().out)["minibatch_size"] == 64
