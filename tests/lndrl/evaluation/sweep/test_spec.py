from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from lndrl.config import REPOSITORY_CONFIGS
from lndrl.errors import UserError
from lndrl.evaluation.sweep import load_sweep
from tests.lndrl.evaluation.sweep.helpers_sweep import small_sweep, sweep_file


def test_seeds_are_interleaved_and_settings_applied(tmp_path: Path) -> None:
    sweep, _ = small_sweep(tmp_path)
    runs = sweep.runs()
    assert [run.name for run in runs] == [
        "base-s1", "one-s1", "eight-s1", "base-s2", "one-s2", "eight-s2",
    ]  # fmt: skip
    assert [run.config.seed for run in runs] == [1, 1, 1, 2, 2, 2]
    assert [run.config.ppo.epochs for run in runs[:3]] == [4, 1, 8]
    assert {run.config.ppo.batch_size for run in runs} == {64}
    assert {run.config.learner.total_steps for run in runs} == {1000}
    assert [variant.group for variant in sweep.variants] == ["", "ppo.epochs", "ppo.epochs"]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"step": 5}, "unknown key step; did you mean steps?"),
        ({"steps": 0}, "steps = 0"),
        ({"seeds": []}, "seeds"),
        ({"seeds": [1, 1]}, "a seed is named twice"),
        ({"variants": {}}, "variants"),
        ({"variants": {"base": {"set": ["a=1"], "why": "x"}}}, "choose another name"),
        ({"variants": {"a/b": {"set": ["a=1"], "why": "x"}}}, "'a/b' must be letters"),
        ({"variants": {"a": {"set": ["ppo.epochs=1"]}}}, "variants.a.why is missing"),
        ({"variants": {"a": {"set": [], "why": "x"}}}, "variants.a.set"),
        (
            {"variants": {"a": {"set": ["ppo.epoch=1"], "why": "x"}}},
            "variant a: .*unknown key ppo.epoch; did you mean epochs?",
        ),
        ({"variants": {"a": {"set": ["ppo.epochs=4"], "why": "x"}}}, "a is the same .* as base"),
        ({"variants": {"a": {"set": ["seed=3"], "why": "x"}}}, "name them in seeds"),
        ({"set": ["learner.total_steps=9"]}, "variant base: .*say steps"),
        ({"set": ["learner.patience=9"]}, "variant base: .*runs are compared at equal steps"),
        ({"config": "none.yaml"}, "none.yaml: no such file"),
    ],
)
def test_wrong_files_are_one_sentence(
    changes: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    file = sweep_file(tmp_path, **changes)
    with pytest.raises(UserError, match=sentence) as caught:
        load_sweep(file)
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_runs_of_a_base_that_would_end_early_have_equal_steps(tmp_path: Path) -> None:
    base = "base: lndrl\nlearner: {patience: 100, validation_episodes: 10}\n"
    (tmp_path / "early.yaml").write_text(base)
    sweep = load_sweep(sweep_file(tmp_path, config="early.yaml"))
    assert {run.config.learner.patience for run in sweep.runs()} == {0}


def test_runs_start_from_another_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sweep, _ = small_sweep(tmp_path, start="runs/first")
    assert {run.config.learner.start for run in sweep.runs()} == {str(tmp_path / "runs/first")}
    with pytest.raises(UserError, match="runs/first is no run folder with a checkpoint"):
        sweep.check_start()
    (tmp_path / "runs/first/checkpoints/step-000000010").mkdir(parents=True)
    sweep.check_start()


@pytest.mark.parametrize("name", ["ppo", "later", "smoke", "from-nothing", "from-example"])
def test_shipped_sweeps_are_right(name: str) -> None:
    path = REPOSITORY_CONFIGS / "sweeps" / f"{name}.yaml"
    sweep = load_sweep(path)
    assert len(sweep.runs()) == len(sweep.variants) * len(sweep.spec.seeds)
    assert len(sweep.variants) == 1 + len(yaml.safe_load(path.read_text())["variants"])
