"""What the first convolution of the scan encoder answers to one scan (PAPER Fig. 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.policy.networks import FanScanEncoder, ScanEncoder, build_policy
from lndrl.policy.tensors import load_into


@dataclass(frozen=True)
class FirstLayer:
    """Activations after the ReLU: values float32 (channels, positions).

    ``beams`` (positions,) is the beam in the middle of what each position reads; numbers between
    beams and outside of the scan may occur.
    """

    values: NDArray[np.float32]
    beams: NDArray[np.float64]


def first_layer(config: RunConfig, weights: bytes, scan: NDArray[np.uint16]) -> FirstLayer:
    """The first layer's answer to ``scan`` (scan_frames * beams,), counts as an observation has.

    Raises UserError when ``weights`` do not fit the networks of ``config``.
    """
    network = build_policy(config, initialize=False)
    encoder = getattr(network, "scan_encoder", None)
    if not isinstance(encoder, ScanEncoder | FanScanEncoder):
        raise UserError(
            "only the built-in scan encoders show their first layer, not one of "
            f"{config.network.scan_encoder if encoder else config.network.policy}"
        )
    load_into(network, weights)
    with torch.inference_mode():
        inputs = torch.from_numpy(scan * np.float32(1.0 / SCAN_COUNTS))
        values = encoder.first(inputs[None])[0].numpy()
    (stride,), (size,) = encoder.conv1.stride, encoder.conv1.kernel_size
    padding = encoder.conv1.padding[0]
    assert isinstance(padding, int)
    beams = np.arange(values.shape[1], dtype=np.float64) * stride - padding + (size - 1) / 2
    return FirstLayer(values, np.asarray(beams, np.float64))
