"""``lndrl runs``: what it says of runs in every state, and what it never removes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from learner.run.best import save_best
from learner.run.folder import RunFolder
from lndrl.cli.main import run as lndrl
from lndrl.config import RunConfig, load_config
from lndrl.policy import build_policy, to_bytes
from lndrl.transport.messages import COUNTS

NONE = {**dict.fromkeys(COUNTS, 0)}


def made(name: str, updates: int, settings: tuple[str, ...] = (), unix: float = 1e9) -> RunFolder:
    """A run folder as the learner leaves it, released."""
    config = load_config("lndrl", ["learner.total_steps=5000", *settings])
    folder = RunFolder.create(Path("runs") / name, config)
    rows = [
        {
            "update": i,
            "steps": 1000 * i,
            "episodes": {"count": 9 * i, "arrived": i / 10, "lost": 0.25, "mean_return": 100.0 * i},
        }
        for i in range(1, updates + 1)
    ]
    lines = "".join(json.dumps(row) + "\n" for row in rows)
    metrics = folder.path / "metrics.jsonl"
    metrics.write_text(lines + '{"update": 99, "cut')
    if updates:
        (folder.checkpoints / f"step-{1000 * updates:09d}").mkdir()
    folder.release()
    for path in (metrics, folder.path / "run.json"):
        os.utime(path, (unix, unix))
    return folder


def summarise(folder: RunFolder, steps: int) -> None:
    folder.write_summary({"finished": True, "steps": steps})


@pytest.fixture(autouse=True)
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    yield


def listed(capsys: pytest.CaptureFixture[str]) -> dict[str, dict[str, Any]]:
    assert lndrl(["runs", "--json"]) == 0
    return {run["name"]: run for run in json.loads(capsys.readouterr().out)}


def test_no_run_yet_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert lndrl(["runs"]) == 0
    assert "no run exists" in capsys.readouterr().out


def test_every_state_is_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    summarise(made("done", 5), 5000)
    summarise(made("beyond", 6), 5000)  # it went on, and was killed
    made("stopped", 3)
    made("nothing", 0)
    held = RunFolder.open(made("held", 2).path)
    (made("hurt", 2).path / "config.yaml").write_text("learner: {total_stepz: 1}\n")
    Path("runs/other").mkdir()
    states = {name: run["state"] for name, run in listed(capsys).items()}
    assert states == {
        "done": "finished",
        "beyond": "stopped",
        "stopped": "stopped",
        "nothing": "empty",
        "held": "training",
        "hurt": "damaged",
    }
    # To look changes nothing: the learner's note of who it is stays.
    assert json.loads((held.path / "lock").read_text())["pid"] == os.getpid()
    held.release()
    assert listed(capsys)["held"]["state"] == "stopped"


def test_the_newest_comes_first_with_what_it_says_of_itself(
    capsys: pytest.CaptureFixture[str],
) -> None:
    made("old", 1, unix=1e9)
    new = made("new", 3, unix=1.1e9)
    config = load_config(new.path / "config.yaml")
    sampled = {**NONE, "episodes": 8, "arrived": 6, "lost": 2}
    facts = {"version": 1, "steps": 2000, "unix": 1.0, "under": "", "score": 0.75}
    weights = to_bytes(build_policy(config))
    save_best(new.checkpoints, config, weights, {**facts, "sampled": sampled, "greedy": sampled})
    found = listed(capsys)
    assert list(found) == ["new", "old"]
    told = found["new"]
    assert (told["steps"], told["total"], told["episodes"]) == (3000, 5000, 27)
    assert (told["arrived"], told["lost"], told["collided"]) == (0.3, 0.25, None)
    assert (told["validated"], told["validated_of"]) == (0.75, 8)
    assert told["checkpoint"] == "step-000003000" and told["size"] > len(weights)
    assert lndrl(["runs"]) == 0
    shown = capsys.readouterr().out
    assert "75.0%" in shown and "3,000 of 5,000" in shown
    assert "lndrl train --run new --resume" in shown


def test_two_are_compared_at_the_step_that_both_have_reached(
    capsys: pytest.CaptureFixture[str],
) -> None:
    made("a", 5)
    made("b", 2, ("ppo.epochs=7",))
    assert lndrl(["runs", "compare", "runs/a", "runs/b", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["common_steps"] == 2000
    assert [row["arrived"] for row in told["at_common_steps"]] == [0.2, 0.2]
    default = RunConfig.model_validate({"scenario": load_config("lndrl").scenario}).ppo
    assert load_config("lndrl").ppo.epochs != 7 != default.epochs
    assert told["configuration"] == {"ppo.epochs": [load_config("lndrl").ppo.epochs, 7]}
    assert lndrl(["runs", "compare", "runs/a", "runs/b"]) == 0
    assert "arrived at step 2,000" in capsys.readouterr().out
    assert lndrl(["runs", "compare", "runs/a", "runs/c"]) == 2
    assert "runs/c: is no run folder" in capsys.readouterr().err


def test_removing_asks_and_spares_what_trains_and_what_is_no_run(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made("a", 1)
    made("b", 1)
    held = RunFolder.open(made("held", 2).path)
    Path("runs/other").mkdir()
    Path("outside").mkdir()
    Path("outside/run.json").write_text("{}")
    Path("runs/link").symlink_to(Path("outside").resolve())
    for names, sentence in (
        (["a", "held"], "a learner is at work there"),
        (["a", "other"], "is no run folder"),
        (["../outside"], "without a path"),
        (["."], "without a path"),
        (["link"], "is a link"),
    ):
        assert lndrl(["runs", "rm", *names, "--yes"]) == 2
        assert sentence in capsys.readouterr().err
    answers, asked = iter([False, True]), []

    def confirm(words: str) -> bool:
        asked.append(words)
        return next(answers)

    monkeypatch.setattr("typer.confirm", confirm)
    assert lndrl(["runs", "rm", "a", "b"]) == 1 and Path("runs/a").exists()
    assert "a (1,000 steps), b (1,000 steps)" in asked[0]
    assert lndrl(["runs", "rm", "a", "b"]) == 0
    assert lndrl(["runs", "rm", "a"]) == 2
    left = sorted(path.name for path in Path("runs").iterdir())
    assert left == ["held", "link", "other"] and Path("outside/run.json").exists()
    held.release()
