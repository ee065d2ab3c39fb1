"""The networks on the CPU: what a few people change in a map, and two small convolutions.

NumPy and compiled kernels alone, so that whoever only acts needs no torch; gradients are here, too,
and become operations of torch in ``lndrl.policy.gradients``.
"""

from lndrl.policy.sparse import cells, convolution, first, patches, rows, scan, structure
from lndrl.policy.sparse.structure import (
    LEVELS,
    STAND_IN,
    MapStructure,
    drawn_structure,
    map_structure,
    stand_in_cells,
)

KERNELS = (
    *structure.KERNELS, *patches.KERNELS, *first.KERNELS, *convolution.KERNELS, *cells.KERNELS,
    *scan.KERNELS,
)  # fmt: skip
"""What acting calls from Python."""
COARSE_KERNELS = (*rows.KERNELS, *scan.COARSE_KERNELS)
"""What acting in bfloat16 calls beside these."""

__all__ = [
    "COARSE_KERNELS",
    "KERNELS",
    "LEVELS",
    "STAND_IN",
    "MapStructure",
    "drawn_structure",
    "map_structure",
    "stand_in_cells",
]
