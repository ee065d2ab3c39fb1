"""Which runs the methods of a bench need; nothing is trained here."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
import yaml

from lndrl.config import RunConfig, load_config
from lndrl.curve import conditions
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    PAPER,
    MethodRun,
    MethodsFolder,
    load_benchmark,
    method_runs,
)
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
    files = {run.name.removeprefix("table-"): run.file.stem for run in runs}
    assert files == {
        **{name: name for name in ("drl_laser", "drl_laser_ped", "no_variance", "no_reward")},
        **{name: name for name in ("drl_laser_ped-alone", "paper")},
        **{name: name for name in ("no_variance-alone", "no_reward-alone")},
        **{name: name for name in ("drl_laser-trusting", "drl_laser_ped-trusting")},
        **{name: "table-lndrl" for name in ("lndrl", "lndrl-seed2", "lndrl-seed3")},
        "lndrl-alone": "table-alone",
        "lndrl-careful": "table-careful",
    }
    assert all(run.name.startswith("table-") for run in runs)
    seeds = {run.name: run.config.seed for run in runs if run.config.seed != 1}
    assert seeds == {"table-lndrl-seed2": 2, "table-lndrl-seed3": 3}


def test_the_papers_rows_are_taught_alike_and_all_train_as_long() -> None:
    runs = {run.file.stem: run for run in method_runs(load_benchmark(), load_benchmark_folder())}
    taught = [runs[n] for n in ("table-lndrl", *sorted({*PAPER} - {"dwa", "lndrl"}))]
    assert len(taught) == 5
    assert len({str((r.config.ppo, r.config.imitation, r.config.learner)) for r in taught}) == 1
    assert taught[0].config.ppo.teacher == "predictive"
    ends = [(r.config.learner.total_steps, r.config.learner.patience) for r in runs.values()]
    assert set(ends) == {(1_000_000, 0)}
    assert {r.config.learner.validation_episodes for r in runs.values()} == {400}
    # What is no row alone is what it is elsewhere, but for how it is validated.
    for name in ("table-careful", "paper"):
        learner = load_config(name).learner.model_copy(
            update={"validation_episodes": 400, "total_steps": 1_000_000}
        )
        expected = load_config(name).model_copy(update={"learner": learner})
        assert runs[name].config == expected


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


def test_a_row_names_its_configuration_and_its_seed(configs: Path) -> None:
    text = (configs / "bench.yaml").read_text()
    rows = "  three: {planner: runs/one-seed3, config: one.yaml, seed: 3}\n"
    (configs / "bench.yaml").write_text(text + rows)
    (run,) = plan(configs, "three").methods
    assert (run.name, run.config.seed, run.file.stem) == ("one-seed3", 3, "one")
    assert [r.name for r in plan(configs, "one", "three").methods] == ["one", "one-seed3"]
    # Whoever asks for that seed of the other row asks for the same run.
    assert [r.name for r in plan(configs, "one", "three", seed=3).methods] == ["one-seed3"]
    with pytest.raises(UserError, match="method three is of seed 3, not 2; leave out --seed"):
        plan(configs, "three", seed=2)
    spec = load_benchmark(configs / "bench.yaml")
    spec = spec.model_copy(update={"methods": {n: spec.methods[n] for n in ("one", "three")}})
    names = [[run.name for run in method_runs(spec, configs, seed=seed)] for seed in (None, 2, 3)]
    assert names == [["one", "one-seed3"], ["one-seed2"], ["one-seed3"]]


def test_two_rows_in_one_run_folder_must_be_one_run(configs: Path) -> None:
    text = (configs / "bench.yaml").read_text()
    rows = "  three: {planner: runs/one, config: one.yaml, seed: 3}\n"
    (configs / "bench.yaml").write_text(text + rows)
    with pytest.raises(UserError, match="method three: another method is trained into runs/one "):
        plan(configs, "one", "three")
    (configs / "bench.yaml").write_text(text + "  four: {planner: runs/f, config: none.yaml}\n")
    with pytest.raises(UserError, match=r"method four: config: none\.yaml: no such file"):
        plan(configs, "four")


def test_what_the_bench_says_of_training_holds_for_all(configs: Path) -> None:
    text = (configs / "bench.yaml").read_text()
    (configs / "bench.yaml").write_text(text + "training: [ppo.gamma=0.5, learner.patience=0]\n")
    folder = plan(configs, steps=500)
    assert [run.config.ppo.gamma for run in folder.methods] == [0.5, 0.5]
    assert [run.config.learner.total_steps for run in folder.methods] == [500, 500]
    write_run(folder, "one", 100)
    with pytest.raises(UserError, match=r"trained with ppo\.gamma 0\.99, the bench says 0\.5; "):
        folder.check()


def test_a_run_whose_arrivals_no_longer_rise_is_finished(configs: Path) -> None:
    text = (configs / "bench.yaml").read_text()
    rule = "training: [learner.validation_episodes=20, learner.patience=300]\n"
    (configs / "bench.yaml").write_text(text + rule)
    folder = plan(configs)
    write_run(folder, "one", 600)  # by whoever knew nothing of the rule
    (run, _) = folder.methods
    validate(folder, run, 10, 18, 10, 10)
    assert jobs(folder) == {"one": "resume", "two": "train"}
    assert folder.early(run) == ""
    validate(folder, run, 10, 18, 10, 10, 8)
    folder.check()
    assert jobs(folder) == {"one": None, "two": "train"}
    assert folder.early(run).startswith("validated arrivals have not risen from step 200 to 500, ")
    assert jobs(plan(configs, steps=9000))["one"] is None, "more steps are no more arrivals"
    write_run(folder, "two", 1000)
    validate(folder, folder.methods[1], 10, 18, 10, 10, 8)
    assert folder.early(folder.methods[1]) == "", "it has its steps"
    (configs / "bench.yaml").write_text(text + rule.replace("=20", "=10"))
    assert jobs(plan(configs))["one"] == "resume", "other episodes are no measure"
    (configs / "bench.yaml").write_text(text)
    assert jobs(plan(configs))["one"] == "resume"


def test_a_run_is_finished_by_its_own_rule_where_the_bench_has_none(configs: Path) -> None:
    """As the learner concludes it when it is resumed: by what stands in the run's folder."""
    folder = plan(configs)
    write_run(folder, "one", 600)
    (run, _) = folder.methods
    kept = folder.run_path(run) / "config.yaml"
    data = yaml.safe_load(kept.read_text())
    data["learner"] |= {"validation_episodes": 20, "patience": 300}
    kept.write_text(yaml.safe_dump(data))
    validate(folder, run, 10, 18, 10, 10, 8, config=load_config(kept))
    assert jobs(folder)["one"] is None and folder.early(run)
    data["learner"]["patience"] = 0
    kept.write_text(yaml.safe_dump(data))
    assert jobs(folder)["one"] == "resume"


def validate(
    folder: MethodsFolder, run: MethodRun, *arrived: int, config: RunConfig | None = None
) -> None:
    """Add what an evaluator found of versions 1, 2 ..., a hundred steps each."""
    under = conditions(config or run.config)
    lines = []
    for version, each in enumerate(arrived, 1):
        counts = {"episodes": 20, "arrived": each, "collided": 20 - each,
                  "lost": 0, "timeout": 0, "steps": 400}  # fmt: skip
        row = {"version": version, "steps": 100 * version, "unix": 1.0, "under": under,
               "sampled": counts, "greedy": counts}  # fmt: skip
        lines.append(json.dumps({"update": version, "validation": row}) + "\n")
    path = folder.run_path(run) / "metrics.jsonl"
    own = [line for line in path.read_text().splitlines(True) if "validation" not in line]
    path.write_text("".join([*own, *lines]))


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
    early = method_line(one.name, 1000, folder.newest(one), early=True)
    assert early.startswith("one: 960 of 1,000 steps (no longer rose), 210 steps/s")
    assert isinstance(one, MethodRun)
