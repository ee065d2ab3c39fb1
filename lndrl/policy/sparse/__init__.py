"""The networks on the CPU: what a few people change in a map, and two small convolutions."""

from lndrl.policy.sparse import cells, convolution, patches, rows, scan, structure
from lndrl.policy.sparse.cells import cell_linear, train_cell_linear
from lndrl.policy.sparse.convolution import convolve_patches, weight_at_points
from lndrl.policy.sparse.products import linear
from lndrl.policy.sparse.rows import convolve_pool, flat_weight
from lndrl.policy.sparse.scan import scan_convolutions
from lndrl.policy.sparse.structure import (
    LEVELS,
    STAND_IN,
    MapStructure,
    drawn_structure,
    map_structure,
    stand_in_cells,
)

KERNELS = (
    *structure.KERNELS, *patches.KERNELS, *rows.KERNELS, *convolution.KERNELS, *cells.KERNELS,
    *scan.KERNELS,
)  # fmt: skip
"""What acting calls from Python."""

__all__ = [
    "KERNELS",
    "LEVELS",
    "STAND_IN",
    "MapStructure",
    "cell_linear",
    "convolve_patches",
    "convolve_pool",
    "drawn_structure",
    "flat_weight",
    "linear",
    "map_structure",
    "scan_convolutions",
    "stand_in_cells",
    "train_cell_linear",
    "weight_at_points",
]
