from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from lndrl.config import RunConfig
from lndrl.evaluation import evaluate
from lndrl.evaluation.shipping import compare, met
from lndrl.navigation import EpisodeRecord, Observation
from lndrl.planners import PlannerSource
from lndrl.policy import build_policy, to_bytes
from lndrl.policy.shipped import narrowed, widened


@pytest.fixture(scope="module")
def config() -> RunConfig:
    scenario = {
        "name": "room",
        "size": [7, 5],
        "pedestrians": {"count": [1, 1], "routes": [{"start": [3, 1, 4, 4], "goal": [3, 1, 4, 4]}]},
        "robot": [{"start": [1, 1, 2, 4], "goal": [5, 1, 6, 4]}],
    }
    return RunConfig.model_validate(
        {
            "scenario": scenario,
            "task": {"time_limit": 4.0},
            "localization": {"min_particles": 100, "max_particles": 100},
            "network": {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4},
        }
    )


@pytest.fixture(scope="module")
def blob(config: RunConfig) -> bytes:
    torch.manual_seed(1)
    return to_bytes(build_policy(config))


@pytest.fixture(scope="module")
def seen(config: RunConfig, blob: bytes) -> Observation:
    other = config.model_copy(update={"seed": 5})
    return met(PlannerSource("it", config, blob), [config, other], 41)


@pytest.fixture(scope="module")
def records(config: RunConfig, blob: bytes) -> tuple[EpisodeRecord, ...]:
    return evaluate(PlannerSource("it", config, blob), config, 8).records


def test_observations_are_really_met_and_as_many_in_each_place(seen: Observation) -> None:
    assert len(seen) == 42
    assert (seen.goal[:, 3:] > 0.0).any() and len(np.unique(seen.goal, axis=0)) > 30


def test_weights_agree_with_themselves(
    config: RunConfig, blob: bytes, seen: Observation, records: tuple[EpisodeRecord, ...]
) -> None:
    found = compare(config, blob, blob, seen, (records, records))
    assert (found.greatest, found.greedy_changed, found.sampled_changed) == (0.0, 0.0, 0.0)
    assert found.other_outcomes == 0 and found.p == 1.0 and found.complaints == []
    assert found.observations == 42 and found.episodes == 8


def test_half_precision_agrees_within_noise(
    config: RunConfig, blob: bytes, seen: Observation, records: tuple[EpisodeRecord, ...]
) -> None:
    half = widened(narrowed(blob, {}), {})
    found = compare(config, blob, half, seen, (records, records))
    assert 0.0 < found.greatest < 0.05 and found.greatest_likely <= found.greatest


def test_other_weights_are_told_by_their_decisions(
    config: RunConfig, blob: bytes, seen: Observation, records: tuple[EpisodeRecord, ...]
) -> None:
    torch.manual_seed(2)
    network = build_policy(config)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.mul_(3.0)
    found = compare(config, blob, to_bytes(network), seen, (records, records))
    assert found.greedy_changed > 0.1 and "greedy decisions are others" in found.complaints[0]


def test_others_arrivals_are_told(
    config: RunConfig, blob: bytes, seen: Observation, records: tuple[EpisodeRecord, ...]
) -> None:
    arrived = [replace(record, outcome="arrived") for record in records]
    lost = [replace(record, outcome="lost") for record in records]
    found = compare(config, blob, blob, seen, (arrived, lost))
    assert found.arrived == (8, 0) and found.other_outcomes == 8 and found.p == 2 / 2**8
    assert found.complaints == ["it arrives in 0 instead of 8 of 8 episodes (p 0.00781)"]
