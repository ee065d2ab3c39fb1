"""Networks and encoders of one's own: built, trained, saved, loaded, and looked at first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation import Observation
from lndrl.policy import (
    PolicyRunner,
    build_policy,
    build_value,
    check_layout,
    first_layer,
    initial_weights,
    load_into,
    prepare,
    supports_sparse,
    to_bytes,
)
from lndrl.policy.acting.remote import DevicePolicy

Write = Callable[..., str]
SCENARIO = {
    "name": "room",
    "size": [6, 4],
    "pedestrians": {"count": [0, 0]},
    "robot": [{"start": [1, 1, 2, 3], "goal": [4, 1, 5, 3]}],
}
NETWORK = """
    import torch
    from torch import nn

    class Net(nn.Module):
        def __init__(self, config, outputs, units=8):
            super().__init__()
            self.layer = nn.Linear(720, units)
            self.maps = nn.Conv2d(3, 2, 3)
            self.head = nn.Linear(units + 2 + 6, outputs)

        def forward(self, inputs):
            people = self.maps(inputs.people).mean(dim=(2, 3))
            seen = torch.tanh(self.layer(inputs.scan))
            return self.head(torch.cat([seen, people, inputs.goal], dim=1))
"""
ENCODER = """
    import torch
    from torch import nn

    class Enc(nn.Module):
        def __init__(self, config, features=5):
            super().__init__()
            self.features = features
            self.scale = nn.Parameter(torch.full((features,), 0.25))
            self.inner = nn.Linear(1, features, bias=False)
            nn.init.constant_(self.inner.weight, 3.0)

        def forward(self, values):
            return self.inner(values.flatten(1).mean(dim=1, keepdim=True)) * self.scale
"""


def made_config(**network: Any) -> RunConfig:
    small = {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4}
    return RunConfig.model_validate(
        {"scenario": SCENARIO, "task": {"map_cells": 24}, "network": {**small, **network}}
    )


def observation(config: RunConfig, rows: int = 3) -> Observation:
    made = Observation.zeros_for(rows, config)
    generator = np.random.default_rng(0)
    made.scan[:] = generator.integers(65535, size=made.scan.shape)
    made.goal[:] = generator.normal(size=made.goal.shape)
    made.pedestrians[:, 0, :2] = 0.5
    made.pedestrian_count[:] = 1
    return made


def test_one_class_makes_both_networks(own_module: Write) -> None:
    name = f"{own_module(NETWORK)}:Net"
    config = made_config(policy=name, policy_settings={"units": 6})
    assert not supports_sparse(config)
    inputs = prepare(observation(config), config)
    assert build_policy(config)(inputs).shape == (3, 28)
    assert build_value(config)(inputs).shape == (3, 1)


KNOWING_NETWORK = """
    import torch
    from torch import nn

    class Net(nn.Module):
        def __init__(self, config, outputs):
            super().__init__()
            self.head = nn.Linear(6 + (18 if outputs == 1 else 0), outputs)
            self.value = outputs == 1

        def forward(self, inputs):
            assert (inputs.privileged is not None) == self.value
            parts = [inputs.goal] + ([inputs.privileged] if self.value else [])
            return self.head(torch.cat(parts, dim=1))
"""


def test_only_its_value_network_is_given_privileged_floats(own_module: Write) -> None:
    """Else a policy would learn from what it does not have when it acts."""
    config = made_config(policy=f"{own_module(KNOWING_NETWORK)}:Net", pedestrian_map=False)
    config = config.model_copy(
        update={"learner": config.learner.model_copy(update={"privileged_critic": True})}
    )
    inputs = prepare(observation(config), config, np.ones((3, 18), np.float32))
    assert build_policy(config)(inputs).shape == (3, 28)
    assert build_value(config)(inputs).shape == (3, 1)


@pytest.mark.parametrize("bfloat16", [False, True])
def test_it_acts_like_any_other(own_module: Write, bfloat16: bool) -> None:
    config = made_config(policy=f"{own_module(NETWORK)}:Net")
    runner = PolicyRunner(config, bfloat16=bfloat16)
    runner.load(initial_weights(config))
    seen = observation(config)
    first = runner.log_probabilities(seen)
    np.testing.assert_allclose(np.exp(first).sum(axis=1), 1.0, rtol=1e-3)
    # As on a GPU, which draws the maps itself.
    on_device = DevicePolicy(build_policy(config), config)
    on_device.load(initial_weights(config))
    tolerance = 0.05 if bfloat16 else 1e-5
    np.testing.assert_allclose(on_device.log_probabilities(seen), first, atol=tolerance)


def test_weights_travel(own_module: Write) -> None:
    config = made_config(policy=f"{own_module(NETWORK)}:Net")
    torch.manual_seed(3)
    one, other = build_policy(config), build_policy(config)
    load_into(other, to_bytes(one))
    inputs = prepare(observation(config), config)
    assert torch.equal(one(inputs), other(inputs))


@pytest.mark.parametrize("key", ["scan_encoder", "map_encoder"])
def test_an_encoder_sits_in_the_built_in_network(own_module: Write, key: str) -> None:
    name = f"{own_module(ENCODER)}:Enc"
    config = made_config(**{key: name, f"{key}_settings": {"features": 7}})
    assert supports_sparse(config) is (key == "scan_encoder")
    network = build_policy(config)
    assert network.trunk.in_features == 8 + 4 + 7  # type: ignore[union-attr]
    encoder = getattr(network, key)
    assert (encoder.encoder.inner.weight == 3.0).all()  # its own initialization stays
    inputs = prepare(observation(config), config)
    network(inputs).sum().backward()
    assert encoder.encoder.scale.grad is not None
    for bfloat16 in (False, True):
        runner = PolicyRunner(config, bfloat16=bfloat16)
        assert np.isfinite(runner.log_probabilities(observation(config))).all()


def test_an_own_scan_encoder_may_read_several_scans(own_module: Write) -> None:
    name = f"{own_module(ENCODER)}:Enc"
    data = made_config(scan_encoder=name).model_dump()
    config = RunConfig.model_validate({**data, "task": {**data["task"], "scan_frames": 3}})
    network = build_policy(config)
    assert network(prepare(observation(config), config)).shape == (3, 28)


def test_it_is_refused_unless_trusted(own_module: Write) -> None:
    config = made_config(policy=f"{own_module(NETWORK, trusted=False)}:Net")
    with pytest.raises(UserError, match=r"^network\.policy: policy network .* is refused"):
        PolicyRunner(config)
    config = made_config(scan_encoder=f"{own_module(ENCODER, trusted=False)}:Enc")
    with pytest.raises(UserError, match=r"^network\.scan_encoder: encoder .* is refused"):
        PolicyRunner(config)


@pytest.mark.parametrize(
    ("body", "forward", "sentence"),
    [
        ("nn.Linear(720, outputs)", "self.a(inputs.scan)[:, :-1]", r"answers with \[2, 27\] where"),
        ("nn.Linear(720, outputs)", "self.a(inputs.scan).long()", "a tensor of floats, not torch"),
        ("nn.Linear(720, outputs)", "3", "a tensor of floats, not int"),
        ("nn.Linear(720, outputs)", "self.a(inputs.scan) / 0", "answers an empty observation with"),
        ("nn.Linear(720, outputs)", "self.a(inputs.scans)", "failed: AttributeError"),
        ("nn.Linear(720, outputs)", "self.a(torch.rand(2, 720))", "the same input differently"),
        ("nn.Linear(9, outputs)", "self.a(inputs.scan)", "failed: RuntimeError: mat1 and mat2"),
        ("nn.ReLU()", "torch.zeros(2, 28)", "has no parameters to train"),
        (
            "nn.Sequential(nn.Linear(720, outputs), nn.BatchNorm1d(outputs))",
            "self.a(inputs.scan)",
            "only float32 weights travel",
        ),
    ],
)
def test_what_it_does_wrong_is_said_at_once(
    own_module: Write, body: str, forward: str, sentence: str
) -> None:
    name = own_module(f"""
        import torch
        from torch import nn

        class Net(nn.Module):
            def __init__(self, config, outputs):
                super().__init__()
                self.a = {body}

            def forward(self, inputs):
                return {forward}
    """)
    with pytest.raises(UserError, match=f"policy network {name}:Net.*{sentence}"):
        build_policy(made_config(policy=f"{name}:Net"))


@pytest.mark.parametrize("features", ["None", "0", "'many'"])
def test_an_encoder_says_how_much_it_gives(own_module: Write, features: str) -> None:
    name = own_module(ENCODER.replace("self.features = features", f"self.features = {features}"))
    with pytest.raises(UserError, match="must say how many features they give"):
        build_policy(made_config(scan_encoder=f"{name}:Enc"))


def test_a_misspelt_encoder_suggests_the_right_one() -> None:
    with pytest.raises(UserError, match=r"network\.scan_encoder: encoder fann is unknown; did you"):
        build_policy(made_config(scan_encoder="fann"))


def test_settings_need_a_class_of_ones_own() -> None:
    with pytest.raises(ValueError, match="scan_encoder_settings go to a class of your own"):
        made_config(scan_encoder_settings={"a": 1})


def test_weights_of_another_class_are_told_apart(own_module: Write) -> None:
    name = f"{own_module(NETWORK)}:Net"
    own, built_in = made_config(policy=name, policy_settings={"units": 6}), made_config()
    with pytest.raises(UserError, match=rf'trained with network {name} of {{"units": 6}}; this'):
        check_layout("runs/a", own, built_in)
    with pytest.raises(UserError, match=r"this configuration has network .*:Net"):
        check_layout("runs/a", built_in, made_config(policy=name))


def test_only_built_in_encoders_show_their_first_layer(own_module: Write) -> None:
    name = f"{own_module(ENCODER)}:Enc"
    config = made_config(scan_encoder=name)
    with pytest.raises(UserError, match=f"only the built-in scan encoders .* not one of {name}"):
        first_layer(config, initial_weights(config), observation(config).scan[0])


def test_the_built_in_networks_are_named_as_before() -> None:
    config = made_config()
    assert "scan_encoder.conv1.weight" in build_policy(config).state_dict()
    assert (config.network.policy, config.network.map_encoder) == ("lndrl", "lndrl")
