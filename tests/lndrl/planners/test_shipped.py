from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from lndrl import load_policy
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.planners import (
    ShieldConfig,
    ShieldedPlanner,
    has_weights,
    is_own_planner,
    is_rule,
    planner_source,
)
from lndrl.policy import (
    TEMPERATURE_KEY,
    build_policy,
    driven_at,
    policy_metadata,
    read_policy,
    to_bytes,
)
from lndrl.policy.blob import metadata_in
from lndrl.policy.shipped import narrowed

TEMPERED = {TEMPERATURE_KEY: "0.25"}
SMALL = {"map_channels": (2, 2, 2), "features": 8, "goal_features": 4}


def saved(config: RunConfig, folder: Path, said: dict[str, str] | None = None) -> str:
    """A run folder that holds a policy of ``config``."""
    torch.manual_seed(0)
    folder.mkdir()
    blob = to_bytes(build_policy(config), {**policy_metadata(config, 0, 0), **(said or {})})
    (folder / "policy.safetensors").write_bytes(blob)
    return str(folder)


def test_shipped_is_a_policy_wherever_a_planner_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # anywhere
    source = planner_source("shipped")
    assert source.weights is not None and source.config is not None
    assert (source.name, source.label, source.title) == ("shipped", "shipped", "shipped")
    assert has_weights("shipped") and not is_rule("shipped") and not is_own_planner("shipped")
    assert load_policy("shipped").config == source.config
    assert source.origin.startswith("the policy that comes with lndrl ")
    assert source.temperature == load_policy("shipped").temperature == driven_at(source.weights)


def test_a_shield_goes_round_a_policy_and_says_so(config: RunConfig, tmp_path: Path) -> None:
    small = config.model_copy(update={"network": config.network.model_copy(update=SMALL)})
    run = saved(small, tmp_path / "run")
    source = planner_source(run, shield=ShieldConfig(horizon=0.8))
    assert source.title == f"{run}+shield" and source.label == "run+shield"
    planner = source.build(small)
    assert isinstance(planner, ShieldedPlanner) and planner.parameters.horizon == 0.8
    assert not isinstance(planner_source(run).build(small), ShieldedPlanner)


@pytest.mark.parametrize("rule", ["dwa", "careful", "random", "my_package:Planner"])
def test_a_shield_for_what_ranks_nothing_is_one_sentence(rule: str) -> None:
    with pytest.raises(UserError, match=f"{rule}: ranks no actions that a shield could choose"):
        planner_source(rule, shield=ShieldConfig())


def test_a_shield_for_a_policy_without_people_is_refused_before_anything_runs(
    config: RunConfig, tmp_path: Path
) -> None:
    network = config.network.model_copy(update={**SMALL, "pedestrian_map": False})
    run = saved(config.model_copy(update={"network": network}), tmp_path / "laser")
    with pytest.raises(UserError, match="its observation has no people"):
        planner_source(run, shield=ShieldConfig())
    assert planner_source(run).weights is not None


def test_a_folder_of_that_name_is_written_as_a_path(
    config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    small = config.model_copy(update={"network": config.network.model_copy(update=SMALL)})
    saved(small, tmp_path / "shipped")
    assert planner_source("./shipped").config == small
    assert planner_source("shipped").config != small


def test_shipped_has_no_checkpoints() -> None:
    with pytest.raises(UserError, match=r"^shipped: is one policy, which has no checkpoint best"):
        planner_source("shipped", checkpoint="best")


# -- the temperature that a policy is meant to be sampled at ---------------------------------


def test_a_policy_is_sampled_at_what_its_file_says_unless_another_is_named(
    config: RunConfig, tmp_path: Path
) -> None:
    small = config.model_copy(update={"network": config.network.model_copy(update=SMALL)})
    source = planner_source(saved(small, tmp_path / "run", TEMPERED), shield=ShieldConfig())
    assert source.temperature == 0.25 and source.at_temperature(2.0).temperature == 2.0
    planner = source.build(small)
    assert isinstance(planner, ShieldedPlanner)
    assert planner.planner.temperature == 0.25  # type: ignore[attr-defined]
    assert planner_source(saved(small, tmp_path / "plain")).temperature == 1.0


def test_half_precision_keeps_it(config: RunConfig, tmp_path: Path) -> None:
    small = config.model_copy(update={"network": config.network.model_copy(update=SMALL)})
    file = Path(saved(small, tmp_path / "run", TEMPERED)) / "policy.safetensors"
    file.write_bytes(narrowed(file.read_bytes(), metadata_in(file.read_bytes())))
    found = read_policy(file)
    assert found.temperature == driven_at(found.weights) == 0.25


def test_from_python_it_acts_at_its_own_temperature(config: RunConfig, tmp_path: Path) -> None:
    small = config.model_copy(update={"network": config.network.model_copy(update=SMALL)})
    run = saved(small, tmp_path / "run", {TEMPERATURE_KEY: "0.01"})

    def drawn(temperature: float | None) -> list[int]:
        policy, generator = load_policy(run, seed=1), np.random.default_rng(0)
        shapes = policy._shapes
        seen = {name: generator.random((100, *shape)) for name, shape in shapes.items()}
        return np.asarray(policy.act(seen, temperature=temperature)).tolist()

    assert drawn(None) == drawn(0.01) != drawn(1.0)


@pytest.mark.parametrize("wrong", ["0", "-1", "nan", "1e9", "warm", ""])
def test_a_file_with_a_temperature_that_is_none_is_refused(
    wrong: str, config: RunConfig, tmp_path: Path
) -> None:
    small = config.model_copy(update={"network": config.network.model_copy(update=SMALL)})
    run = saved(small, tmp_path / "run", {TEMPERATURE_KEY: wrong})
    with pytest.raises(UserError, match=r"policy.safetensors: lndrl.temperature is .* inside, and"):
        planner_source(run)
