"""The exported policy computes what the policy does, whatever network it has."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.errors import UserError
from lndrl.policy import (
    TEMPERATURE_KEY,
    PolicyRunner,
    build_policy,
    initial_weights,
    load_into,
    policy_metadata,
    to_bytes,
)
from lndrl.policy.export import (
    METADATA_KEY,
    Exported,
    export,
    export_policy,
    feeds_for,
    observations_met,
    open_session,
    round_trip,
)
from tests.lndrl.policy.export.rooms import FEW, made_config, weights_of

Write = Callable[..., str]
OWN = """
    import torch
    from torch import nn

    class Net(nn.Module):
        def __init__(self, config, outputs):
            super().__init__()
            self.layer = nn.Linear(720, outputs)
            self.maps = nn.Conv2d(3, outputs, 3)
            self.goal = nn.Linear(6, outputs)

        def forward(self, inputs):
            people = self.maps(inputs.people).amax(dim=(2, 3))
            return self.layer(inputs.scan) + people + self.goal(inputs.goal)

    class Enc(nn.Module):
        def __init__(self, config):
            super().__init__()
            self.features = 5
            self.layer = nn.Linear(1, 5)

        def forward(self, values):
            return self.layer(values.flatten(1).mean(dim=1, keepdim=True))
"""


def runner_of(config: RunConfig, weights: bytes) -> PolicyRunner:
    runner = PolicyRunner(config)
    runner.load(weights)
    return runner


def test_a_thousand_observations_of_the_default_network() -> None:
    config = load_config(REPOSITORY_CONFIGS / "lndrl.yaml")
    weights = weights_of(config)
    exported = export_policy(config, weights, "here", observations=1000, timed=0.01)
    # Not what the export says of itself: its file, run here on what is met under another seed.
    runner, session = runner_of(config, weights), open_session(exported.model)
    met = observations_met(runner, 1000, seed=5)
    assert len(np.unique(met.scan, axis=0)) == 1000 and len(np.unique(met.pedestrian_count)) > 5
    answers = [
        session.run(None, feeds_for(part, config))[0]
        for part in map(met.take, np.split(np.arange(1000), 50))
    ]
    expected = runner.log_probabilities(met)
    assert np.abs(np.concatenate(answers) - expected).max() <= 1e-4
    assert expected.std(axis=0).max() > 0.1  # so that it says something
    assert exported.trip.observations == 1000 and exported.trip.difference <= 1e-4


@pytest.mark.parametrize(
    ("task", "network"),
    [
        ({}, {"pedestrian_map": False}),
        ({}, {"variances": False}),
        ({}, {"pooling": "none"}),
        ({"map_cells": 30}, {}),  # no sparse evaluation to compare with
        ({"scan_frames": 3}, {"scan_encoder": "fan"}),
        ({"scan_frames": 3}, {"scan_encoder": "fan", "pedestrian_map": False}),
        ({"max_pedestrians": 2, "linear_velocities": [0.0, 0.5]}, {"variance_scale": 4.0}),
    ],
)
def test_every_kind_of_network(task: dict[str, Any], network: dict[str, Any]) -> None:
    config = made_config(task, **network)
    weights = weights_of(config)
    exported = export_policy(config, weights, "here", FEW, timed=0.01)
    assert exported.trip.holds and exported.trip.difference < 1e-5
    runner, session = runner_of(config, weights), open_session(exported.model)
    again = round_trip(session, runner, observations_met(runner, FEW, seed=9))
    assert again.holds and again.spread > 0.01


@pytest.mark.parametrize(
    "network",
    [{"policy": "Net"}, {"scan_encoder": "Enc"}, {"map_encoder": "Enc"}],
)
def test_parts_of_ones_own(own_module: Write, network: dict[str, str]) -> None:
    name = own_module(OWN)
    config = made_config(**{key: f"{name}:{value}" for key, value in network.items()})
    assert export_policy(config, weights_of(config), "here", FEW, timed=0.01).trip.holds


Made = tuple[onnxruntime.InferenceSession, dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def made(exported: Exported) -> Made:
    """An exported policy and what it reads where somebody is in view."""
    config = made_config()
    session = open_session(exported.model)
    runner = runner_of(config, weights_of(config))
    met = observations_met(runner, FEW, seed=1)
    return session, feeds_for(met.take(met.pedestrian_count > 0), config)


@pytest.mark.parametrize("part", ["scan", "people", "count", "goal", "variances"])
def test_every_input_reaches_the_answer(part: str, made: Made) -> None:
    session, feeds = made
    (before,) = session.run(None, feeds)
    assert len(before) > 5
    changed = {name: array.copy() for name, array in feeds.items()}
    if part in ("goal", "variances"):
        changed["goal"][:, slice(0, 3) if part == "goal" else slice(3, 6)] += 1.0
    elif part == "people":
        changed["people"] *= -1.0
    else:
        changed[part] //= 2
    (after,) = session.run(None, changed)
    assert (np.abs(after - before).max(axis=1) > 1e-3).all()


def without(model: bytes, lost: str) -> onnx.ModelProto:
    """A graph that has lost one of its inputs: it reads zeros wherever that was read."""
    blind = onnx.load_from_string(model)
    for node in blind.graph.node:
        node.input[:] = ["blind" if name == lost else name for name in node.input]
    blind.graph.initializer.append(onnx.numpy_helper.from_array(np.zeros(1, np.float32), "zero"))
    blind.graph.node.insert(0, onnx.helper.make_node("Mul", [lost, "zero"], ["blind"]))
    del blind.metadata_props[:]
    return blind


@pytest.mark.parametrize("lost", ["scan", "people", "goal"])
def test_a_graph_that_has_lost_an_input_is_noticed(
    lost: str, monkeypatch: pytest.MonkeyPatch, first_exported: Exported
) -> None:
    config = made_config()
    monkeypatch.setattr(export, "to_onnx", lambda *_: without(first_exported.model, lost))
    with pytest.raises(UserError, match=r"^runs/r: .* differ by .*, so nothing was written"):
        # Even in first weights, which say nearly the same to everything.
        export_policy(config, initial_weights(config), "runs/r", FEW, timed=0.01)


def test_first_weights_pass_too(first_exported: Exported) -> None:
    assert first_exported.trip.holds and first_exported.trip.tolerance <= 1e-4


def test_the_temperature_that_it_is_meant_for_is_inside() -> None:
    config = made_config()
    said = {**policy_metadata(config, 7, 1234), TEMPERATURE_KEY: "0.25"}
    network = build_policy(config)
    load_into(network, weights_of(config))
    runner = runner_of(config, to_bytes(network))
    exported = export_policy(config, to_bytes(network, said), "here", FEW, timed=0.01)
    assert exported.trip.holds and exported.trip.difference < 1e-4
    met = observations_met(runner, FEW, seed=3)
    (answer,) = open_session(exported.model).run(None, feeds_for(met, config))
    plain = runner.log_probabilities(met)
    expected = np.exp(plain.astype(np.float64) * 4.0)
    expected /= expected.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(np.exp(answer), expected, atol=1e-5)
    assert np.abs(np.exp(plain) - expected).max() > 0.05
    assert exported.contract["policy"]["temperature"] == 0.25
    assert "temperature 0.25 is already in them" in exported.contract["outputs"][0]["meaning"]


def test_an_answer_that_is_no_number_is_noticed(exported: Exported) -> None:
    config = made_config()
    runner = runner_of(config, weights_of(config))
    broken = onnx.load_from_string(exported.model)
    (answer,) = [part.name for part in broken.graph.output]
    for node in broken.graph.node:
        node.output[:] = ["sound" if name == answer else name for name in node.output]
    nothing = onnx.numpy_helper.from_array(np.full(1, np.nan, np.float32), "nothing")
    broken.graph.initializer.append(nothing)
    broken.graph.node.append(onnx.helper.make_node("Add", ["sound", "nothing"], [answer]))
    session = open_session(broken.SerializeToString())
    assert not round_trip(session, runner, observations_met(runner, 3, seed=1)).holds


def test_files_say_what_they_are(tmp_path: Path, exported: Exported) -> None:
    out = tmp_path / "policy.onnx"
    exported.write(out)
    exported.write(out)  # over itself
    assert sorted(path.name for path in tmp_path.iterdir()) == ["policy.json", "policy.onnx"]
    contract = json.loads((tmp_path / "policy.json").read_text())
    (inside,) = [
        entry.value for entry in onnx.load(out).metadata_props if entry.key == METADATA_KEY
    ]
    assert contract.pop("file")["bytes"] == out.stat().st_size
    assert contract == json.loads(inside) == exported.contract
    assert open_session(out.read_bytes()).get_modelmeta().custom_metadata_map == {
        METADATA_KEY: inside
    }
