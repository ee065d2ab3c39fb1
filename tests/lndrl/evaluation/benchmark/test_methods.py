"""Rows that are policies: whose layout, temperature, shield and guard are whose."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    Plan,
    ResultsFolder,
    bench_config,
    contender_tested,
    contenders,
    load_benchmark,
)
from lndrl.evaluation.benchmark.spec import guard_of, policy_of
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.policy import build_policy, policy_metadata, to_bytes

LEARNED = """
scenarios: [sparse]
methods:
  small: {planner: runs/small}
  oracle: {planner: runs/small, localization: perfect}
  mine: {planner: runs/mine}
"""


def learned_bench(folder: Path, *settings: str) -> Path:
    """A bench with ``small.yaml`` beside it and a policy, trained with ``settings`` over that."""
    small = ["network.map_channels=[4,4,8]", "network.features=16", "network.goal_features=8"]
    (folder / "configs").mkdir()
    (folder / "configs/small.yaml").write_text(load_config(DEFAULT_CONFIG, small).to_yaml())
    path = folder / "configs/bench.yaml"
    path.write_text(LEARNED)
    trained = load_config(folder / "configs/small.yaml", list(settings))
    for run in ("small", "mine"):
        (folder / "runs" / run).mkdir(parents=True)
        blob = to_bytes(build_policy(trained), policy_metadata(trained, 0, 0))
        (folder / "runs" / run / "policy.safetensors").write_bytes(blob)
    return path


def test_a_run_of_another_layout_than_its_methods_configuration_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = learned_bench(tmp_path, "network.variances=false", "ppo.gamma=0.5")
    for command in ([], ["--methods", "oracle"]):
        assert lndrl(["benchmark", "--spec", str(spec), "--episodes", "1", *command]) == 2
        name = command[-1] if command else "small"
        assert capsys.readouterr().err == (
            f"lndrl: method {name}: runs/small: trained with no variances; "
            "configs/small.yaml has variances\n"
        )
    assert not Path("results").exists()
    # No file says how this one is trained: it is tested under its own layout.
    found, _ = contenders(load_benchmark(spec), ["mine"], configs=spec.parent)
    found[0].source.build(bench_config(found[0], "sparse", 0))


def test_a_row_may_name_another_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = learned_bench(tmp_path, "network.variances=false")
    (tmp_path / "configs/blind.yaml").write_text("base: small.yaml\nnetwork: {variances: false}\n")
    text = spec.read_text()
    spec.write_text(
        text.replace("planner: runs/small}", "planner: runs/small, config: blind.yaml}")
    )
    found, _ = contenders(load_benchmark(spec), configs=spec.parent)
    assert [each.name for each in found] == ["small", "oracle", "mine"], "oracle shares its run"
    spec.write_text(text + "training: [network.variances=false]\n")
    contenders(load_benchmark(spec), configs=spec.parent)
    spec.write_text(text.replace("planner: runs/small}", "planner: runs/small, config: blnd.yaml}"))
    with pytest.raises(UserError, match=r"^method small: config: blnd\.yaml: no such file; "):
        contenders(load_benchmark(spec), configs=spec.parent)


def test_learning_settings_may_differ_from_the_methods_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = learned_bench(tmp_path, "ppo.gamma=0.5", "task.reward.pose=0", "seed=7")
    found, _ = contenders(load_benchmark(spec), configs=spec.parent)
    assert [each.name for each in found] == ["small", "oracle", "mine"]


def test_temperature_and_shield_of_a_method_are_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = learned_bench(tmp_path)
    spec.write_text(
        spec.read_text()
        + "  cold: {planner: runs/small, temperature: 0.3, shield: {horizon: 0.8}}\n"
        + "  warm: {planner: runs/small, temperature: 2}\n"
        + "  shielded: {planner: runs/small, shield: true}\n"
        + "  guarded: {planner: runs/small, temperature: 0.3, guard: {people_speed: 1.0}}\n"
        + "  both: {planner: predictive, settings: {goal_weight: 9}, guard: true}\n"
    )
    found, _ = contenders(load_benchmark(spec), configs=spec.parent)
    small, oracle, _, cold, warm, shielded, guarded, both = found
    digest = small.identity
    assert oracle.identity == digest and len(digest) == 16
    assert warm.identity == f"{digest} at 2.0"
    assert cold.identity.startswith(f'{digest} at 0.3 shield {{"horizon":0.8,')
    assert shielded.identity.startswith(f'{digest} shield {{"horizon":1.2,')
    assert guarded.identity.startswith(f'{digest} at 0.3 guard {{"people_speed":1.0,')
    assert both.identity.startswith("predictive {") and both.source.title == "predictive+guard"
    for each in found:
        driver, guard = guard_of(each.identity)
        assert guard == each.source.guard
        temperature, shield = policy_of(driver)
        assert (temperature or 1.0, shield) == (each.source.temperature, each.source.shield)
    # The likeliest action is the same one at any temperature.
    (greedy,), _ = contenders(load_benchmark(spec), ["warm"], greedy=True, configs=spec.parent)
    assert greedy.identity == digest
    # Whoever replays what was tested gets the same planner, whatever the file says of itself.
    folder = ResultsFolder(tmp_path / "results")
    Plan(folder, found, ["sparse"], 1, 3).left()
    for each in found:
        again, _ = contender_tested(folder, each.name)
        assert again.source.temperature == each.source.temperature
        assert again.source.shield == each.source.shield and again.identity == each.identity
        assert again.source.guard == each.source.guard


def test_a_methods_temperature_is_a_policys(tmp_path: Path) -> None:
    spec = tmp_path / "bench.yaml"
    methods = "scenarios: [sparse]\nmethods: {rule: {planner: dwa, temperature: %s}}\n"
    spec.write_text(methods % "0.5")
    with pytest.raises(UserError, match="method rule: dwa: has no policy to sample"):
        contenders(load_benchmark(spec))
    spec.write_text(methods % "0")
    with pytest.raises(UserError, match=r"methods\.rule\.temperature"):
        load_benchmark(spec)


def test_a_laser_that_the_bench_has_not_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = learned_bench(tmp_path, "world.laser.range_max=30")
    with pytest.raises(UserError, match=r"mine: .* a range of 30 m; the bench has a range of 12 m"):
        contenders(load_benchmark(spec), ["mine"], configs=spec.parent)
