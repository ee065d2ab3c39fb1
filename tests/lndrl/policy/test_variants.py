"""Networks of the baselines and ablations: what each reads, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.navigation import Observation
from lndrl.policy import CompactObservation, Inputs, PolicyRunner, build_policy, prepare, to_bytes
from tests.lndrl.policy.built_in import built_in

NAMES = ["lndrl", "table-lndrl", "drl_laser", "drl_laser_ped", "no_variance", "no_reward"]


def config_of(name: str) -> RunConfig:
    small = ["network.map_channels=[8, 12, 16]", "network.features=32"]
    return load_config(REPOSITORY_CONFIGS / f"{name}.yaml", small)


def observation_for(config: RunConfig, samples: int = 5) -> Observation:
    rng = np.random.default_rng(1)
    made = Observation.zeros_for(samples, config)
    made.scan[:] = rng.integers(0, 65536, made.scan.shape)
    made.goal[:] = rng.uniform(0, 2, made.goal.shape)
    made.pedestrian_count[:] = 3
    made.pedestrians[:, :3] = rng.uniform(-2, 2, (samples, 3, 4))
    return made


def answer(config: RunConfig, observation: Observation) -> torch.Tensor:
    torch.manual_seed(0)
    network = built_in(build_policy(config))
    torch.nn.init.normal_(network.head.weight)
    with torch.no_grad():
        return network(prepare(observation, config))


@pytest.mark.parametrize("name", NAMES)
def test_each_reads_what_its_row_of_the_table_says(name: str) -> None:
    config = config_of(name)
    observation = observation_for(config)
    before = answer(config, observation)
    assert before.shape == (5, 28)

    def changes(part: str) -> bool:
        other = observation.copy()
        if part == "variances":
            other.goal[:, 3:] += 1.0
        elif part == "people":
            other.pedestrians[:, 0, :2] += 0.5
        elif part == "goal":
            other.goal[:, :3] += 0.5
        else:
            frame = slice(0, 720) if part == "oldest scan" else slice(-720, None)
            other.scan[:, frame] //= 2
        return not torch.allclose(answer(config, other), before)

    assert changes("goal") and changes("newest scan")
    assert changes("variances") == (name in ("lndrl", "table-lndrl", "no_reward"))
    assert changes("people") == (name != "drl_laser")
    assert changes("oldest scan")
    assert observation.scan.shape[1] == (2160 if name.startswith("drl") else 720)


def test_drl_laser_is_the_network_of_its_paper() -> None:
    config = load_config(REPOSITORY_CONFIGS / "drl_laser.yaml")
    shapes = {name: tuple(p.shape) for name, p in build_policy(config).named_parameters()}
    # 720 beams -> 359 -> 180 windows of 32 channels (parameters §7.1).
    assert shapes == {
        "scan_encoder.conv1.weight": (32, 3, 5), "scan_encoder.conv1.bias": (32,),
        "scan_encoder.conv2.weight": (32, 32, 3), "scan_encoder.conv2.bias": (32,),
        "scan_encoder.linear.weight": (256, 5760), "scan_encoder.linear.bias": (256,),
        "trunk.weight": (128, 259), "trunk.bias": (128,),
        "head.weight": (28, 128), "head.bias": (28,),
    }  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_actors_and_devices_see_the_same(name: str) -> None:
    config = config_of(name)
    observation = observation_for(config)
    torch.manual_seed(0)
    network = build_policy(config)
    runner = PolicyRunner(config)
    runner.load(to_bytes(network))
    with torch.no_grad():
        expected = network(prepare(observation, config))
        scan, goal, maps = CompactObservation.view(observation).expand(config.task)
        dense = network(Inputs(scan, goal, maps))
    torch.testing.assert_close(dense, expected, atol=1e-5, rtol=1e-5)
    log_probs = torch.log_softmax(expected, dim=1).numpy()
    action, log_prob = runner.act(observation, np.random.default_rng(0))
    np.testing.assert_allclose(log_prob, log_probs[np.arange(5), action], atol=1e-5)
