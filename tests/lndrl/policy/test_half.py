from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load, save

from lndrl.config import RunConfig, load_config
from lndrl.errors import UserError
from lndrl.navigation import Observation
from lndrl.policy import PolicyRunner, load_policy, policy_metadata
from lndrl.policy.blob import metadata_in
from lndrl.policy.networks import build_policy
from lndrl.policy.shipped import (
    LARGEST_FILE,
    SHIPPED_FILE,
    narrowed,
    parameters_in,
    widened,
)
from lndrl.policy.tensors import to_bytes

ROOT = Path(__file__).resolve().parents[3]
SHIPPED_PARAMETERS = 7_615_804 + 2 * 512
"""The paper's network, and a scale and an offset for each of its trunk's 512 units."""
SMALL = {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4}


@pytest.fixture(scope="module")
def config() -> RunConfig:
    settings = [f"network.{key}={value}" for key, value in SMALL.items()]
    return load_config("lndrl", settings)


@pytest.fixture(scope="module")
def blob(config: RunConfig) -> bytes:
    torch.manual_seed(3)
    return to_bytes(build_policy(config), policy_metadata(config, 7, 1234))


def test_half_precision_is_half_the_size_and_keeps_what_a_file_says(blob: bytes) -> None:
    metadata = metadata_in(blob)
    half = narrowed(blob, metadata)
    assert metadata["lndrl.steps"] == "1234" and metadata_in(half) == metadata
    assert {tensor.dtype for tensor in load(half).values()} == {torch.float16}
    assert len(half) < 0.75 * len(blob) and parameters_in(half) == parameters_in(blob)


def test_it_comes_back_as_single_precision_and_a_float16s_digits(blob: bytes) -> None:
    back = widened(narrowed(blob, metadata_in(blob)), metadata_in(blob))
    assert metadata_in(back) == metadata_in(blob)
    for name, tensor in load(back).items():
        assert tensor.dtype == torch.float32
        assert torch.equal(tensor, load(blob)[name].half().float())
    assert widened(blob, {}) is blob


def test_the_same_weights_are_the_same_bytes_every_time(blob: bytes) -> None:
    metadata = metadata_in(blob)
    half = narrowed(blob, metadata)
    for order in (sorted(metadata), sorted(metadata, reverse=True)):
        shuffled = {key: metadata[key] for key in order}
        assert narrowed(blob, shuffled) == half
        assert widened(half, shuffled) == widened(half, metadata)


def test_a_number_that_it_does_not_have_is_refused() -> None:
    big = save({"layer.weight": torch.tensor([1.0, 1e5])})
    with pytest.raises(UserError, match=r"mine: layer.weight holds a number beyond 65504"):
        narrowed(big, {}, "mine")


def test_a_file_in_half_precision_is_loaded_and_acts_alike(
    config: RunConfig, blob: bytes, tmp_path: Path
) -> None:
    file = tmp_path / "policy.safetensors"
    file.write_bytes(narrowed(blob, metadata_in(blob)))
    read, weights = load_policy(file)
    assert read == config
    observation = Observation.zeros_for(4, config)
    observation.scan[:] = np.random.default_rng(0).integers(0, 65535, observation.scan.shape)
    answers = []
    for each in (blob, weights):
        runner = PolicyRunner(config)
        runner.load(each)
        answers.append(runner.log_probabilities(observation))
    assert np.abs(answers[0] - answers[1]).max() < 0.01


def test_the_shipped_policy_is_small_enough_and_the_papers_network() -> None:
    blob = SHIPPED_FILE.read_bytes()
    assert len(blob) <= LARGEST_FILE and parameters_in(blob) == SHIPPED_PARAMETERS
    assert {tensor.dtype for tensor in load(blob).values()} == {torch.float16}
    config, weights = load_policy("shipped")
    assert config == load_policy(SHIPPED_FILE)[0] and weights == load_policy(Path("shipped"))[1]
    PolicyRunner(config).load(weights)


def test_it_was_trained_in_hybrid_or_generated_layouts_alone() -> None:
    config, _ = load_policy("shipped")
    places = config.scenario.parts
    assert all(place.name == "hybrid" or place.kind == "random" for place in places)


def test_the_model_card_is_of_these_weights() -> None:
    data = json.loads((ROOT / "docs/model-card.json").read_text())
    assert data["weights"]["sha256"] == hashlib.sha256(SHIPPED_FILE.read_bytes()).hexdigest()


def test_a_folder_of_that_name_is_reached_as_a_path(
    blob: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shipped").mkdir()
    (tmp_path / "shipped" / "policy.safetensors").write_bytes(blob)
    assert parameters_in(load_policy("shipped")[1]) == SHIPPED_PARAMETERS
    assert load_policy("./shipped")[1] == blob
