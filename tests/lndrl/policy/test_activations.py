"""The first layer as a picture shows it, against one computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.errors import UserError
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.policy import build_policy, first_layer, to_bytes
from tests.lndrl.policy.built_in import scan_encoder_of

SMALL = ["network.features=8", "network.goal_features=4"]
FAN = ["network.scan_encoder=fan", "network.pedestrian_map=false", "task.scan_frames=3"]
ENCODERS = {"lndrl": SMALL, "fan": [*SMALL, *FAN]}


def config_of(encoder: str) -> RunConfig:
    return load_config(REPOSITORY_CONFIGS / "lndrl.yaml", ENCODERS[encoder])


@pytest.mark.parametrize("encoder", ENCODERS)
def test_it_is_the_plain_convolution(encoder: str) -> None:
    config = config_of(encoder)
    network = build_policy(config)
    conv1 = scan_encoder_of(network).conv1
    assert conv1.bias is not None
    torch.nn.init.normal_(conv1.bias, std=0.1)
    frames = config.task.scan_frames
    scan = np.random.default_rng(0).integers(0, 65536, frames * 720).astype(np.uint16)
    layer = first_layer(config, to_bytes(network), scan)
    weight, bias = (p.detach().numpy() for p in conv1.parameters())
    x = scan.reshape(frames, 720) / SCAN_COUNTS - (0.5 if encoder == "fan" else 0.0)
    stride, padding = (2, 1) if encoder == "fan" else (3, 0)
    x = np.pad(x, ((0, 0), (padding, padding)))
    for position in (0, 1, 100, len(layer.beams) - 1):
        window = x[:, position * stride : position * stride + 5]
        expected = np.maximum((weight * window).sum(axis=(1, 2)) + bias, 0.0)
        np.testing.assert_allclose(layer.values[:, position], expected, atol=1e-5)
        # In the middle of its five beams.
        assert layer.beams[position] == position * stride - padding + 2


@pytest.mark.parametrize("encoder", ENCODERS)
def test_a_bump_in_the_scan_answers_at_its_beam(encoder: str) -> None:
    config = config_of(encoder)
    network = build_policy(config)
    conv1 = scan_encoder_of(network).conv1
    assert conv1.bias is not None
    with torch.no_grad():
        conv1.weight.fill_(1.0)
        conv1.bias.fill_(9.0)  # nothing is cut off at zero
    scan = np.zeros(config.task.scan_frames * 720, np.uint16)
    quiet = first_layer(config, to_bytes(network), scan)
    scan[-720 + 500] = 65535
    layer = first_layer(config, to_bytes(network), scan)
    moved = layer.beams[np.abs(layer.values - quiet.values).max(axis=0) > 1e-3]
    assert 1 <= len(moved) <= 3
    assert np.all(np.abs(moved - 500) <= 2)


@pytest.mark.parametrize("encoder", ENCODERS)
def test_the_encoder_goes_on_from_it(encoder: str) -> None:
    part = scan_encoder_of(build_policy(config_of(encoder)))
    frames = config_of(encoder).task.scan_frames
    scan = torch.rand(2, frames * 720)

    def rest(first: Tensor) -> Tensor:
        return F.relu(part.linear(F.relu(part.conv2(first)).flatten(1)))

    with torch.inference_mode():
        torch.testing.assert_close(rest(part.first(scan)), part(scan))


def test_weights_of_another_network_are_refused() -> None:
    blob = to_bytes(build_policy(config_of("fan")))
    with pytest.raises(UserError, match="another network"):
        first_layer(config_of("lndrl"), blob, np.zeros(720, np.uint16))
