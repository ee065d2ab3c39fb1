"""``lndrl sweep``: a tiny sweep for real, and what the command refuses before it works."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from lndrl.cli.main import run
from lndrl.cli.training import sweep as command
from tests.lndrl.evaluation.sweep.helpers_here import train_here
from tests.lndrl.evaluation.sweep.helpers_sweep import sweep_file

TINY = [
    "network.map_channels=[4,4,8]",
    "network.features=16",
    "network.goal_features=8",
    "localization.min_particles=100",
    "localization.max_particles=200",
    "ppo.batch_size=64",
    "ppo.minibatch_size=32",
    "learner.threads=1",
    "actor.count=1",
    "actor.worlds=4",
    "actor.horizon=16",
]


def test_a_tiny_sweep_runs_and_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    # Those of the first seed side by side in processes of their own, as all are for users.
    train_here(monkeypatch, unless=lambda command: any(name.endswith("-s1") for name in command))
    variants = {"one": {"set": ["ppo.epochs=1"], "why": "less"}}
    file = sweep_file(tmp_path, set=TINY, steps=256, serial=True, variants=variants)
    assert run(["sweep", str(file), "--parallel", "2", "--markdown", "s.md", "--json"]) == 0
    out, err = capsys.readouterr()
    data = json.loads(out)
    assert [(each["variant"], each["seed"]) for each in data["runs"]] == [
        ("base", 1), ("one", 1), ("base", 2), ("one", 2),
    ]  # fmt: skip
    assert all(each["steps"] == 256 for each in data["runs"])
    one = data["variants"][1]
    assert one["seeds"] == [1, 2] and one["differences"]["kl"]["mean"] < 0.0
    assert err.count("done at step 256") == 4
    assert "| one | 2 of 2 |" in Path("s.md").read_text()
    rows = Path("runs/sweep-small/runs/one-s2/metrics.jsonl")
    before = rows.stat().st_mtime_ns
    assert run(["sweep", str(file), "--plot", "s.png"]) == 0
    assert "sweep small: how episodes end" in capsys.readouterr().out
    assert rows.stat().st_mtime_ns == before
    assert Path("s.png").stat().st_size > 1000


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where a run would start."""

    def work(*_: object) -> int:
        raise AssertionError("runs would start")

    monkeypatch.setattr(command, "_work", work)


@pytest.mark.usefixtures("no_work")
def test_the_table_alone_runs_nothing(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    file = sweep_file(tmp_path)
    before = sorted(os.listdir())
    assert run(["sweep", str(file), "--table"]) == 0
    assert "0 of 2" in capsys.readouterr().out
    assert sorted(os.listdir()) == before


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--markdown", "x.txt"], "--markdown x.txt: must end in .md"),
        (["--markdown", "no/x.md"], "the folder no does not exist"),
        (["--markdown", "full.md"], "has no place for the sweep"),
        (["--plot", "x.pdf"], "--plot x.pdf: must end in .png"),
        (["--parallel", "0"], "--parallel"),
    ],
)
def test_what_cannot_be_written_is_refused_before_any_run(
    options: list[str], sentence: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("full.md").write_text("text\n")
    file = sweep_file(tmp_path)
    assert run(["sweep", str(file), *options]) == 2
    err = capsys.readouterr().err
    assert sentence in err and err.count("\n") == 1
    assert not Path("runs").exists()
