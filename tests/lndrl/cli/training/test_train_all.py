"""``lndrl train-all``: two tiny methods for real, Ctrl-C, and what is refused before any work."""

from __future__ import annotations

import shlex
import signal
from pathlib import Path

import pytest
import yaml

from lndrl.cli.main import run
from lndrl.evaluation import sweep
from tests.lndrl.evaluation.sweep.helpers_here import train_here

SMALL = {
    "scenario": {
        "name": "room",
        "size": [6.0, 4.0],
        "pedestrians": {"count": [0, 0]},
        "robot": [{"start": [1, 1, 2, 3], "goal": [4, 1, 5, 3]}],
    },
    "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
    "ppo": {"batch_size": 64, "minibatch_size": 32, "epochs": 1},
    "learner": {"total_steps": 256, "threads": 1},
    "actor": {"count": 1, "worlds": 4, "horizon": 16},
    "localization": {"min_particles": 100, "max_particles": 200},
}
BENCH = """
scenarios: [sparse]
methods:
  dwa: {planner: dwa}
  one: {planner: runs/one}
  two: {planner: runs/two}
"""


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """``train-all`` for a bench of two small methods, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    configs = tmp_path / "configs"
    configs.mkdir()
    (configs / "bench.yaml").write_text(BENCH)
    (configs / "one.yaml").write_text(yaml.safe_dump(SMALL))
    (configs / "two.yaml").write_text("base: one.yaml\nnetwork: {variances: false}\n")
    return ["train-all", "--spec", "configs/bench.yaml"]


def test_two_methods_are_trained_once(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # The first in a process of its own, as both are for users.
    train_here(monkeypatch, unless=lambda training: "one" in training)
    assert run([*command, "--serial"]) == 0, capsys.readouterr().err
    out, err = capsys.readouterr()
    assert [line.partition(",")[0] for line in out.splitlines()] == [
        "one: 256 of 256 steps",
        "two: 256 of 256 steps",
        "next: lndrl benchmark  # the table",
    ]
    assert err.count("done at step 256") == 2
    assert "variances: false" in Path("runs/two/config.yaml").read_text()
    rows = [Path("runs", name, "metrics.jsonl") for name in ("one", "two")]
    before = [path.stat().st_mtime_ns for path in rows]
    assert run([*command, "--serial"]) == 0
    again = capsys.readouterr()
    assert again.out == out
    assert again.err.count("has its steps, is kept") == 2 and "starts" not in again.err
    assert [path.stat().st_mtime_ns for path in rows] == before


def test_a_method_whose_arrivals_no_longer_rise_is_done(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    train_here(monkeypatch)
    spec = Path(command[-1])
    rule = ["learner.validation_episodes=1", "learner.patience=64", "learner.checkpoint_interval=1"]
    end = ["learner.total_steps=4096", "task.time_limit=0.4", "task.arrive_distance=0.01"]
    spec.write_text(f"{BENCH}training: {[*rule, *end]}\n")
    one = [*command, "--methods", "one", "--serial"]
    assert run(one) == 0, capsys.readouterr().err
    out, err = capsys.readouterr()
    assert out.startswith("one: 192 of 4,096 steps (no longer rose), ")
    why = "validated arrivals have not risen from step 64 to 128, the most are 0.000 at step 64 ("
    assert f"one: done at step 192: {why}" in err
    log = Path("runs/train-all/logs/one.log").read_text()
    assert f"[end] finished at step 192: {why}" in log
    assert run(one) == 0
    again = capsys.readouterr()
    assert again.out == out and f"one: {why}" in again.err and ", is kept" in again.err
    assert "starts" not in again.err and "resumed" not in again.err
    # A bench that waits longer, in a run that was begun under the other rule.
    spec.write_text(f"{BENCH}training: {[*rule[:1], 'learner.patience=192', *rule[2:], *end]}\n")
    assert run(one) == 0, capsys.readouterr().err
    out, err = capsys.readouterr()
    assert "one: resumed at step 192" in err and "not risen from step 64 to 256, " in err
    assert "patience: 192" in Path("runs/one/config.yaml").read_text()


class Endless:
    """A run that goes on until it is interrupted; Ctrl-C comes with the second look."""

    def __init__(self) -> None:
        self.looks = self.interrupted = 0
        self.ended = False

    def poll(self) -> int | None:
        self.looks += 1
        if self.looks == 2:
            signal.raise_signal(signal.SIGINT)
        return 130 if self.interrupted else None

    def interrupt(self) -> None:
        self.interrupted += 1

    def end(self, grace: float) -> None:
        self.ended = True


def test_ctrl_c_interrupts_the_run_and_says_how_to_go_on(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    started: list[tuple[str, list[str], Endless]] = []

    class Trainer(sweep.Trainer):
        def __call__(self, job: sweep.Job) -> Endless:  # type: ignore[override]
            started.append((job.run.name, self.options(job.run), Endless()))
            return started[-1][2]

    monkeypatch.setattr(sweep, "Trainer", Trainer)
    options = ["--steps", "512", "--actors", "2", "--listen", "tcp/127.0.0.1:7555"]
    assert run([*command, *options]) == 130
    ((name, given, process),) = started
    assert (name, given) == ("one", [*options, "--no-dashboard"])
    assert process.interrupted == 1
    again = f"lndrl {shlex.join([*command, *options])}"
    err = capsys.readouterr().err
    assert err.endswith(f"the same command goes on where this one stopped: {again}\n")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--methods", "too"], "'too' is unknown; did you mean two"),
        (["--methods", "dwa"], "method dwa is a rule, nothing to train"),
        (["--methods", ""], "no method is named"),
        (["--steps", "0"], "--steps"),
        (["--actors", "none"], "neither auto nor a whole number"),
        (["--device", "gpu"], "gpu: not a device"),
        (["--listen", "7447"], "--listen 7447: not an endpoint"),
        (["--listen", "tcp/0.0.0.0:7447"], "write tcp/127.0.0.1:PORT"),
        (["--listen", "tls/127.0.0.1:7447"], "write tcp/127.0.0.1:PORT"),
        (["--listen", "tcp/127.0.0.1:1", "--serial"], "does not go with --serial"),
        (["--spec", "none.yaml"], "none.yaml"),
    ],
)
def test_bad_input_is_one_sentence(
    options: list[str], sentence: str, command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*command, *options]) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error and len(error.splitlines()) == 1
    assert not Path("runs").exists()
