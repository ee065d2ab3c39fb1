"""The policy without torch against torch's own evaluation of the same weights."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.navigation import Observation
from lndrl.policy import CompactObservation, Inputs, PolicyRunner, build_policy, to_bytes
from lndrl.policy.acting.modules import ModulePolicy
from lndrl.policy.acting.network import ArrayNetwork, supports_arrays
from lndrl.policy.acting.runner import ArrayPolicy
from lndrl.policy.shapes import parameter_shapes
from lndrl.policy.weights import read_tensors
from tests.lndrl.policy.built_in import built_in
from tests.lndrl.policy.test_networks import adversarial, with_random_biases
from tests.lndrl.policy.test_variants import NAMES, observation_for

SMALL = ["network.map_channels=[8, 12, 16]", "network.features=32", "network.goal_features=8"]
VARIANTS = [
    [],
    ["network.layer_norm=true"],
    ["network.pooling=none", "task.map_cells=24"],
    ["network.variance_scale=7", "world.laser.beams=361"],
]


def config_of(name: str, changes: list[str]) -> RunConfig:
    return load_config(REPOSITORY_CONFIGS / f"{name}.yaml", [*SMALL, *changes])


def weights_of(config: RunConfig) -> tuple[torch.nn.Module, bytes]:
    torch.manual_seed(5)
    network = with_random_biases(built_in(build_policy(config)))
    torch.nn.init.normal_(network.head.weight)
    return network, to_bytes(network)


def dense_answer(network: torch.nn.Module, config: RunConfig, seen: Observation) -> np.ndarray:
    """By torch's dense operations alone, as a GPU evaluates it."""
    with torch.no_grad():
        scan, goal, maps = CompactObservation.view(seen).expand(config.task)
        return torch.log_softmax(network(Inputs(scan, goal, maps)), dim=1).numpy()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("changes", VARIANTS, ids=str)
def test_it_is_the_same_policy(name: str, changes: list[str]) -> None:
    config = config_of(name, changes)
    assert supports_arrays(config)
    network, weights = weights_of(config)
    runner = PolicyRunner(config)
    runner.load(weights)
    assert isinstance(runner.policy, ArrayPolicy)
    for samples in (0, 1, 5, 37):
        seen = observation_for(config, samples)
        expected = dense_answer(network, config, seen)
        found = runner.log_probabilities(seen)
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5)


def test_on_adversarial_maps_too() -> None:
    config = config_of("lndrl", [])
    network, weights = weights_of(config)
    runner = PolicyRunner(config)
    runner.load(weights)
    found, expected = (
        runner.log_probabilities(adversarial()),
        dense_answer(network, config, adversarial()),
    )
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=2e-5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("changes", VARIANTS, ids=str)
def test_shapes_are_those_of_torchs_modules(name: str, changes: list[str]) -> None:
    config = config_of(name, changes)
    state = build_policy(config, initialize=False).state_dict()
    assert parameter_shapes(config) == {name: tuple(t.shape) for name, t in state.items()}


def test_nothing_of_the_blob_is_kept() -> None:
    """Or an actor would hold its weights twice."""
    for name in NAMES:
        config = config_of(name, ["network.layer_norm=true"])
        weights = weights_of(config)[1]
        network = ArrayNetwork(config, read_tensors(weights, parameter_shapes(config)))
        blob = np.frombuffer(weights, np.uint8)
        parts = [part for part in vars(network).values() if part is not None]
        assert len(parts) >= 4 and not any(shares(part, blob) for part in parts), name


def shares(part: Any, blob: np.ndarray) -> bool:
    """Whether any array in ``part`` lies in the memory of ``blob``."""
    if isinstance(part, np.ndarray):
        return np.may_share_memory(part, blob)
    if isinstance(part, list | tuple):
        return any(shares(each, blob) for each in part)
    return hasattr(part, "__dict__") and any(shares(each, blob) for each in vars(part).values())


def test_refused_weights_leave_those_that_act() -> None:
    config = config_of("lndrl", [])
    runner, seen = PolicyRunner(config), observation_for(config)
    runner.load(weights_of(config)[1])
    before = runner.log_probabilities(seen)
    with pytest.raises(Exception, match="another network"):
        runner.load(weights_of(config_of("no_variance", []))[1])
    np.testing.assert_array_equal(runner.log_probabilities(seen), before)


@pytest.mark.parametrize(
    "change", ["task.map_cells=16", "network.map_encoder=own:Encoder", "network.policy=own:Policy"]
)
def test_other_networks_are_torchs(change: str) -> None:
    assert not supports_arrays(config_of("lndrl", [change]))


def test_maps_too_small_to_be_sparse_are_evaluated_by_torch() -> None:
    config = config_of("lndrl", ["task.map_cells=16"])
    network, weights = weights_of(config)
    runner = PolicyRunner(config)
    runner.load(weights)
    assert isinstance(runner.policy, ModulePolicy)
    seen = observation_for(config)
    expected = dense_answer(network, config, seen)
    np.testing.assert_allclose(runner.log_probabilities(seen), expected, rtol=2e-5, atol=2e-5)


ACTING = """
    import sys
    import actors.worker, actors.actor, actors.evaluator, lndrl.evaluation, lndrl.planners
    import numpy as np
    from actors.rollout import Rollout
    from lndrl.planners import planner_source
    from lndrl.policy import read_policy

    policy = read_policy("shipped")
    config = policy.config.model_copy(
        update={"actor": policy.config.actor.model_copy(update={"horizon": 2})}
    )
    rollout = Rollout(config, 0, 1)
    rollout.load(0, policy.weights)
    rollout.collect(0)
    planner_source("shipped").build(config)
    assert "torch" not in sys.modules
"""


def test_an_actor_needs_no_torch(tmp_path: Path) -> None:
    """Half of its memory would be torch's, and two thirds of the time that it takes to start."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ACTING)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[4])},
    )
    assert done.returncode == 0, done.stderr
