"""Weights of another observation layout: every place that meets them names both layouts."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.errors import UserError
from lndrl.planners import make_planner, planner_source
from lndrl.policy import (
    PolicyRunner,
    build_policy,
    check_layout,
    load_into,
    policy_metadata,
    to_bytes,
)
from lndrl.policy.layout import other_layout

SMALL = ["network.map_channels=[4, 4, 8]", "network.features=16", "network.goal_features=8"]


def config_of(name: str = "lndrl", *settings: str) -> RunConfig:
    return load_config(REPOSITORY_CONFIGS / f"{name}.yaml", [*SMALL, *settings])


def weights_of(config: RunConfig) -> bytes:
    return to_bytes(build_policy(config), policy_metadata(config, 0, 0))


@pytest.mark.parametrize(
    ("name", "setting", "trained", "expected"),
    [
        ("no_variance", "seed=1", "no variances", "variances"),
        ("lndrl", "world.laser.beams=360", "360 beams", "720 beams"),
        ("lndrl", "network.pedestrian_map=false", "no pedestrian map", "a pedestrian map"),
        ("lndrl", "network.features=24", "24 features", "16 features"),
        ("lndrl", "network.scan_encoder=fan", "scan encoder fan", "scan encoder lndrl"),
        ("lndrl", "task.linear_velocities=[0.4, 0]", "linear velocities 0, 0.4 m/s",
         "linear velocities 0, 0.2, 0.4, 0.6 m/s"),
        ("drl_laser_ped", "seed=1", "3 scan frames, scan encoder fan, no variances",
         "1 scan frame, scan encoder lndrl, variances"),
    ],
)  # fmt: skip
def test_weights_say_what_they_are_for(
    name: str, setting: str, trained: str, expected: str
) -> None:
    runner = PolicyRunner(config_of())
    with pytest.raises(UserError) as caught:
        runner.load(weights_of(config_of(name, setting)))
    assert (
        str(caught.value) == f"weights: trained with {trained}; this configuration has {expected}"
    )


@pytest.mark.parametrize(
    "setting",
    [
        "world.laser.range_max=30",
        "world.laser.field_of_view=4.7",
        "task.map_extent=8",
        "task.pedestrian_radius=0.2",
        "task.variance_limit=5",
        "task.angular_velocities=[-1, -0.6, -0.3, 0, 0.3, 0.6, 1]",
        "network.variance_scale=2",
    ],
)
def test_a_planner_meets_no_layout_but_its_own_even_of_the_same_shapes(
    setting: str, tmp_path: Path
) -> None:
    file = tmp_path / "policy.safetensors"
    file.write_bytes(weights_of(config_of("lndrl", setting)))
    make_planner(str(file))
    with pytest.raises(UserError, match=r"policy\.safetensors: trained with .*configuration has"):
        planner_source(str(file)).build(config_of())


def test_what_is_no_layout_may_differ() -> None:
    settings = ["ppo.gamma=0.5", "task.reward.pose=0", "world.robot_radius=0.3",
                "network.initialization=default", "task.angular_velocities="
                "[0.9, 0.6, 0.3, 0, -0.3, -0.6, -0.9]", "seed=9"]  # fmt: skip
    check_layout("weights", config_of("lndrl", *settings), config_of())
    # A part that neither network has is nothing that they differ in.
    assert other_layout(config_of("drl_laser", "task.map_extent=9"), config_of("drl_laser")) is None
    wide = config_of("drl_laser", "network.features=64", "network.goal_features=32")
    assert other_layout(wide, config_of("drl_laser")) is None
    load_into(build_policy(config_of("drl_laser")), weights_of(wide))


@pytest.mark.parametrize("inside", ["{}", '{"scenario": 3}', "no json", '["a"]', None])
def test_weights_that_do_not_say_are_told_by_their_tensors(inside: str | None) -> None:
    metadata = None if inside is None else {"lndrl.config": inside}
    blob = to_bytes(build_policy(config_of("no_variance")), metadata)
    with pytest.raises(UserError, match=r"goal_encoder.weight has shape .* another network"):
        PolicyRunner(config_of()).load(blob)


def test_the_command_resumes_and_starts_with_no_other_layout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    tiny = [*SMALL, "ppo.batch_size=32", "ppo.minibatch_size=32", "ppo.epochs=1",
            "actor.count=1", "actor.worlds=2", "actor.horizon=16"]  # fmt: skip
    Path("tiny.yaml").write_text(config_of("lndrl", *tiny).to_yaml())
    assert lndrl(["train", "tiny.yaml", "--serial", "--steps", "32", "--run", "a"]) == 0
    other = ["--set", "network.variances=false"]
    start = ["--run", "b", "--set", "learner.start=runs/a"]
    for options in (["--run", "a", "--resume", *other], ["tiny.yaml", *start, *other]):
        capsys.readouterr()
        assert lndrl(["train", "--serial", "--steps", "64", *options]) == 2
        error = capsys.readouterr().err.strip()
        assert error.endswith("trained with variances; this configuration has no variances")
        assert "runs/a/checkpoints/step-000000032/policy.safetensors: " in error
        assert len(error.splitlines()) == 1
    assert not Path("runs/b").exists()
