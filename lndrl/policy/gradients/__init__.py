"""The parts of the networks that torch would be slow at on the CPU, with gradients.

The arithmetic is that of ``lndrl.policy.sparse``; here it becomes operations of torch.
"""

from lndrl.policy.gradients.cells import cell_linear, train_cell_linear
from lndrl.policy.gradients.convolution import (
    convolve_first,
    convolve_patches,
    convolve_pool,
    flat_weight,
    tap_weight,
    weight_at_points,
)
from lndrl.policy.gradients.dense import linear
from lndrl.policy.gradients.scan import scan_convolutions

__all__ = [
    "cell_linear",
    "convolve_first",
    "convolve_patches",
    "convolve_pool",
    "flat_weight",
    "linear",
    "scan_convolutions",
    "tap_weight",
    "train_cell_linear",
    "weight_at_points",
]
