"""Which runs the methods of a bench need; nothing is trained here."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
import yaml

from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import MethodRun, MethodsFolder, load_benchmark, method_runs
from lndrl.evaluation.sweep import Trainer, next_job
from lndrl.view.methods import method_line

ROOM = {
    "name": "room",
    "size": [6.0, 4.0],
    "pedestrians": {"count": [0, 0]},
    "robot": [{"start": [1, 1, 2, 3], "goal": [4, 1, 5, 3]}],
}
BENCH = {
    "scenarios": ["sparse"],
    "methods": {
        "dwa": {"planner": "dwa"},
        "one": {"planner": "runs/one"},
        "two": {"planner": "runs/two"},
        "truth": {"planner": "runs/one", "localization": "perfect"},
        "lone": {"planner": "runs/lone"},
        "far": {"planner": "elsewhere/far"},
        "no_reward": {"planner": "runs/no_reward"},
    },
}


@pytest.fixture
def configs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a bench and the configurations ``one`` and ``two``; the test works above."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "configs"
    folder.mkdir()
    one = {"scenario": ROOM, "seed": 4, "learner": {"total_steps": 1000}}
    (folder / "one.yaml").write_text(yaml.safe_dump(one))
    (folder / "two.yaml").write_text("base: one.yaml\nnetwork: {variances: false}\n")
    (folder / "far.yaml").write_text("base: one.yaml\n")
    (folder / "bench.yaml").write_text(yaml.safe_dump(BENCH, sort_keys=False))
    return folder


def plan(configs: Path, *methods: str, **options: int) -> MethodsFolder:
    wanted = list(methods) or ["one", "two"]
    runs = method_runs(load_benchmark(configs / "bench.yaml"), configs, wanted, **options)
    return MethodsFolder(Path(), runs)


def write_run(folder: MethodsFolder, name: str, steps: int, *settings: str) -> None:
    """What ``lndrl train`` with ``settings`` leaves at ``steps``."""
    (run,) = [run for run in folder.methods if run.name == name]
    path = folder.run_path(run)
    (path / "checkpoints" / f"step-{steps:09d}").mkdir(parents=True)
    (path / "config.yaml").write_text(load_config(run.file, list(settings)).to_yaml())
    (path / "run.json").write_text('{"run_id": "x"}')
    row = {"update": 1, "steps": steps, "episodes": {"arrived": 0.625},
           "time": {"steps_per_second": 210.4}}  # fmt: skip
    (path / "metrics.jsonl").write_text(json.dumps(row) + "\n")


def jobs(folder: MethodsFolder) -> dict[str, str | None]:
    found = {run.name: next_job(folder, run) for run in folder.runs}
    return {name: job.kind if job else None for name, job in found.items()}


def test_the_bench_of_the_repository_trains_each_run_once() -> None:
    runs = method_runs(load_benchmark(), load_benchmark_folder())
    names = ["drl_laser", "drl_laser_ped", "lndrl", "no_variance", "no_reward"]
    assert [run.name for run in runs] == names
    assert [run.file.stem for run in runs] == names
    assert {run.config.learner.total_steps for run in runs} == {1_200_000}


def load_benchmark_folder() -> Path:
    from lndrl.evaluation.benchmark import BENCHMARK

    return BENCHMARK.parent


def test_what_has_its_steps_is_kept_and_what_has_not_goes_on(configs: Path) -> None:
    assert jobs(plan(configs)) == {"one": "train", "two": "train"}
    folder = plan(configs)
    write_run(folder, "one", 1008)
    write_run(folder, "two", 960, "learner.total_steps=960")  # finished, when less was asked for
    folder.check()
    assert jobs(folder) == {"one": None, "two": "resume"}
    assert jobs(plan(configs, steps=2000)) == {"one": "resume", "two": "resume"}
    assert jobs(plan(configs, steps=500)) == {"one": None, "two": None}
    assert jobs(plan(configs, "truth")) == {"one": None}


def test_another_seed_is_another_run(configs: Path) -> None:
    write_run(plan(configs), "one", 1000)
    folder = plan(configs, "one", "truth", seed=2)
    assert jobs(folder) == {"one-seed2": "train"}
    assert folder.runs[0].config.seed == 2
    assert jobs(plan(configs, "one", seed=4)) == {"one": None}  # its configuration's own


def test_a_run_is_started_with_its_configuration_and_resumed_without(
    configs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = plan(configs, steps=2000)
    write_run(folder, "two", 900)
    started: list[tuple[list[str], object]] = []

    def start(command: list[str], **options: object) -> None:
        started.append((command[3:], options["cwd"]))

    monkeypatch.setattr(subprocess, "Popen", start)
    trainer = Trainer(folder, 0, lambda run: ["--steps", str(run.config.learner.total_steps)])
    for run in folder.runs:
        job = next_job(folder, run)
        assert job is not None
        trainer(job)
    kept = Path("runs/train-all/configs/one.yaml").resolve()
    assert started == [
        (["train", str(kept), "--run", "one", "--steps", "2000"], Path.cwd()),
        (["train", "--run", "two", "--resume", "--steps", "2000"], Path.cwd()),
    ]
    assert load_config(kept) == folder.runs[0].config


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("ppo.gamma=0.5", "runs/one: trained with ppo.gamma 0.5, configs/one.yaml says 0.99; "),
        ("network.variances=false", "runs/one: trained with network.variances false, "),
        ("scenario.name=hall", 'trained with scenario.name "hall", configs/one.yaml says "room"'),
    ],
)
def test_a_run_of_another_configuration_is_refused(
    configs: Path, setting: str, sentence: str
) -> None:
    folder = plan(configs)
    write_run(folder, "one", 1000, setting)
    with pytest.raises(UserError) as caught:
        folder.check()
    assert sentence in str(caught.value)


def test_where_a_run_works_is_free(configs: Path) -> None:
    folder = plan(configs)
    write_run(folder, "one", 1000, "actor.count=7", "learner.device=cuda", "learner.threads=3",
              "transport.endpoint=tcp/127.0.0.1:9", "learner.total_steps=5")  # fmt: skip
    folder.check()


def test_a_folder_that_is_no_run_is_not_cleared_away(configs: Path) -> None:
    folder = plan(configs)
    Path("runs/one").mkdir(parents=True)
    Path("runs/one/thesis.txt").write_text("mine")
    with pytest.raises(UserError, match="runs/one: is no run folder of lndrl; move it away"):
        folder.check()
    Path("runs/one/run.json").write_text("{}")  # a run that died before its first checkpoint
    folder.check()
    assert jobs(folder)["one"] == "train"


@pytest.mark.parametrize(
    ("method", "sentence"),
    [
        ("onne", "method 'onne' is unknown; did you mean one"),
        (
            "dwa",
            "method dwa is a rule, nothing to train; learned are: one, two, truth, lone, far, ",
        ),
        ("lone", "method lone: its configuration .*configs/lone.yaml does not exist"),
        ("far", "method far: planner elsewhere/far is no folder runs/NAME to train into"),
    ],
)
def test_what_cannot_be_trained_is_refused(configs: Path, method: str, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        plan(configs, method)


def test_a_method_without_a_file_beside_the_bench_has_the_programs_own(configs: Path) -> None:
    (run,) = plan(configs, "no_reward").methods
    assert run.config == load_config("no_reward") and run.name == "no_reward"
    (configs / "no_reward.yaml").write_text("base: one.yaml\n")
    (run,) = plan(configs, "no_reward").methods
    assert run.config.scenario.name == "room"


def test_a_method_stands_on_one_line(configs: Path) -> None:
    folder = plan(configs)
    (one, two) = folder.methods
    write_run(folder, "one", 960)
    line = method_line(one.name, 1000, folder.newest(one))
    assert line == "one: 960 of 1,000 steps, 210 steps/s, 62.5 % arrived of late"
    assert method_line(two.name, 1000, folder.newest(two)) == "two: 0 of 1,000 steps"
    assert isinstance(one, MethodRun)
