"""The contract says what the graph and the simulated robot do."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation import action_table
from lndrl.policy import to_bytes
from lndrl.policy.export import contract_for
from lndrl.policy.networks import build_policy
from lndrl.world.laser import beam_bearings
from tests.lndrl.policy.export.rooms import made_config, weights_of


def contract_of(config: RunConfig, weights: bytes = b"") -> dict[str, Any]:
    made: dict[str, Any] = json.loads(json.dumps(contract_for(config, weights, 18)))
    return made


def inputs_of(contract: dict[str, Any]) -> dict[str, Any]:
    return {entry.pop("name"): entry for entry in contract["inputs"]}


def test_the_weights_are_named() -> None:
    config = made_config()
    weights = weights_of(config)
    assert contract_of(config, weights)["policy"] == {
        "version": 7,
        "steps": 1234,
        "weights_sha256": hashlib.sha256(weights).hexdigest(),
        "configuration": config.content_hash(),
        "scenario": "room",
        "temperature": 1.0,
    }
    unsaid = contract_of(config, to_bytes(build_policy(config)))["policy"]
    assert (unsaid["version"], unsaid["steps"]) == (None, None)


@pytest.mark.parametrize("view", [np.pi, 4.7])
def test_bearings_are_those_of_the_simulated_laser(view: float) -> None:
    data = made_config().model_dump()
    data["world"]["laser"].update(beams=360, field_of_view=view)
    config = RunConfig.model_validate(data)
    scan = inputs_of(contract_of(config))["scan"]
    bearings = scan["first_bearing"] + scan["bearing_increment"] * np.arange(scan["beams"])
    np.testing.assert_allclose(bearings, beam_bearings(config.world.laser))
    assert scan["last_bearing"] == pytest.approx(bearings[-1])
    assert scan["shape"] == ["N", 360] and scan["dtype"] == "float32"


def test_actions_keep_their_order() -> None:
    config = made_config({"linear_velocities": [0.5, 0.0], "angular_velocities": [0.3, -0.3]})
    found = contract_of(config)
    rows = [(action["v"], action["w"]) for action in found["actions"]]
    assert [action["index"] for action in found["actions"]] == [0, 1, 2, 3]
    assert np.array_equal(rows, action_table(config.task))
    assert found["outputs"][0]["shape"] == ["N", 4]


def test_periods_and_ages() -> None:
    config = made_config()
    timing = contract_of(config)["timing"]
    assert (timing["control_period"], timing["control_rate"]) == (0.4, 2.5)
    assert (timing["sensor_period"], timing["pose_age"]) == (0.1, 0.4)
    perfect = config.localization.model_copy(update={"kind": "perfect"})
    timing = contract_of(config.model_copy(update={"localization": perfect}))["timing"]
    assert timing["pose_age"] == 0.0


def test_only_what_is_read_is_described() -> None:
    inputs = inputs_of(contract_of(made_config(pedestrian_map=False, variances=False)))
    assert list(inputs) == ["scan", "goal"]
    assert inputs["goal"]["columns"] == ["x", "y", "alpha"] == inputs["goal"]["columns"][:3]
    assert len(inputs["goal"]["unit"]) == 3 and "variances" not in inputs["goal"]


def test_several_scans_have_an_order() -> None:
    scan = inputs_of(contract_of(made_config({"scan_frames": 3}, scan_encoder="fan")))["scan"]
    assert (scan["shape"], scan["beams"], scan["scans"]) == (["N", 2160], 720, 3)
    assert "the newest last" in scan["order"]
    assert "order" not in inputs_of(contract_of(made_config()))["scan"]
