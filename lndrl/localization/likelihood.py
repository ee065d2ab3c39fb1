"""Likelihood field sensor model, looked up instead of computed.

Formula of ROS ``likelihood_field`` (parameters under their ROS names): a particle's weight is
``1 + sum over beams of pz^3`` with ``pz = z_hit exp(-d^2 / (2 sigma_hit^2)) + z_rand / max_range``;
``d`` is the distance (m) from the beam's end to the nearest obstacle, at most
``laser_likelihood_max_dist``, and exactly that much off the map. ``pz^3`` depends on nothing but
the cell, so it is stored per cell and a beam costs one load and one addition.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.errors import UserError
from lndrl.kernels import kernel
from lndrl.localization.angles import sincos
from lndrl.localization.field import beam_factor, obstacle_distance
from lndrl.maps.grid import OccupancyGrid, distance_field
from lndrl.maps.raycast import clearance

Cells = NDArray[np.float32]

BEAMS_PER_PASS = 4  # beams summed in registers before the particle's sum is touched
_ANYWHERE = np.float32(1e7)  # cells, farther than any map


@dataclass(frozen=True)
class LikelihoodMap:
    """What the filter needs of a map; built once per process and shared, never written.

    ``table``: float32 ``(height + 2, width + 2)``, pz^3 per cell inside a border of one cell that
    holds the off-map value, so that a clamped index needs no test. Cell (r, c) of the grid is
    ``table[r + 1, c + 1]`` and lies where the map server puts it (ROS AMCL is half a cell off).
    ``free_cells``: int32 indices ``row * width + column`` of the free cells, for recovery.
    For ``likelihood_field_prob`` the table holds ``log pz`` (see ``field.beam_factor``).
    ``clearance``: uint8 ``(height, width)``, what rays march on; only the beam model has it.
    ``skip_level``, ``agreement_level``: table values at ``beam_skip_distance`` and
    ``agreement_distance``; larger is nearer. ``model``: the ``laser_model_type`` it serves, with
    readings below ``range_max`` m.
    """

    table: NDArray[np.float32]
    free_cells: NDArray[np.int32]
    width: int
    height: int
    resolution: float
    origin: tuple[float, float]
    clearance: NDArray[np.uint8]
    skip_level: float
    agreement_level: float
    model: str
    range_max: float

    @classmethod
    def build(
        cls, grid: OccupancyGrid, config: LocalizationConfig, laser: LaserConfig | None = None
    ) -> LikelihoodMap:
        """Precompute the field of ``grid`` for ``laser``, by default that of the paper.

        Raises UserError when the map has no free cell.
        """
        range_max = config.max_range((laser or LaserConfig()).range_max)
        free_cells = np.flatnonzero(grid.free).astype(np.int32)
        if free_cells.size == 0:
            raise UserError("localization: the map has no free cell, one at least is needed")
        height, width = grid.occupied.shape
        farthest = config.laser_likelihood_max_dist
        distance = np.full((height + 2, width + 2), farthest, dtype=np.float64)
        distance[1:-1, 1:-1] = obstacle_distance(grid, config)
        levels = np.array([config.beam_skip_distance, config.agreement_distance])
        skip_level, agreement_level = beam_factor(levels, config, range_max).astype(np.float32)
        cells = np.zeros((1, 1), dtype=np.uint8)
        if config.laser_model_type == "beam":
            cells = clearance(distance_field(grid.occupied, grid.resolution), grid.resolution)
        return cls(
            np.ascontiguousarray(beam_factor(distance, config, range_max), dtype=np.float32),
            free_cells,
            width,
            height,
            float(grid.resolution),
            (float(grid.origin[0]), float(grid.origin[1])),
            cells,
            float(skip_level),
            float(agreement_level),
            config.laser_model_type,
            range_max,
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> LikelihoodMap:
        return self  # never written, and megabytes


@kernel(_nrt=False, error_model="numpy")
def beam_ends(
    ranges, bearings, range_max, resolution, beams, range_min=-1.0, mount_x=0.0, mount_y=0.0
):
    """End points of the usable beams, in cells, in the robot frame.

    Writes x to ``beams[0]`` and y to ``beams[1]``; readings at or beyond ``range_max``, at or
    below ``range_min`` and non-finite ones are left out, so the particle loop never meets them.
    The scanner stands at ``mount_x``, ``mount_y`` (m, robot frame). Returns the number of beams
    kept and the number of non-finite readings (or bearings).
    """
    kept = 0
    broken = 0
    for i in range(min(ranges.size, bearings.size, beams.shape[1])):
        reading = np.float64(ranges[i])
        bearing = np.float64(bearings[i])
        if not (np.isfinite(reading) and np.isfinite(bearing)):
            broken += 1
        elif 0.0 <= reading < range_max and reading > range_min:
            sine, cosine = sincos(bearing)
            beams[0, kept] = np.float32((reading * cosine + mount_x) / resolution)
            beams[1, kept] = np.float32((reading * sine + mount_y) / resolution)
            kept += 1
    return kept, broken


# Fast, but not so fast that what is not finite could be anything: ``_keep_finite`` looks at it.
@kernel(
    _nrt=False,
    error_model="numpy",
    fastmath={"reassoc", "contract", "arcp", "nsz", "afn"},
)
def to_cells(particles, count, resolution, origin_x, origin_y, cells):
    """Particles (rows x, y, yaw, cos, sin) as float32 rows x, y, cos, sin in table cells."""
    scale = 1.0 / resolution
    for i in range(count):
        cells[0, i] = np.float32((particles[0, i] - origin_x) * scale + 1.0)
        cells[1, i] = np.float32((particles[1, i] - origin_y) * scale + 1.0)
        cells[2, i] = np.float32(particles[3, i])
        cells[3, i] = np.float32(particles[4, i])
    _keep_finite(cells, count)


@kernel(_nrt=False, error_model="numpy")
def _keep_finite(cells, count):
    """Leave nothing in ``cells`` that is not finite: it would become an index of anywhere."""
    for row in range(4):
        for i in range(count):
            value = cells[row, i]
            value = value if value > -_ANYWHERE else -_ANYWHERE  # NaN as well
            cells[row, i] = value if value < _ANYWHERE else _ANYWHERE


@kernel(_nrt=False, error_model="numpy", fastmath=True)
def _index_beam(beam_x, beam_y, x, y, cosine, sine, count, columns, last_x, last_y, index):
    # Vectorises: the border makes every position >= 0.5, so truncation is floor.
    first = np.float32(0.5)
    for i in range(count):
        end_x = x[i] + cosine[i] * beam_x - sine[i] * beam_y
        end_y = y[i] + sine[i] * beam_x + cosine[i] * beam_y
        end_x = min(max(end_x, first), last_x)
        end_y = min(max(end_y, first), last_y)
        index[i] = np.int32(np.int32(np.int32(end_y) * columns) + np.int32(end_x))


@kernel(_nrt=False, error_model="numpy")
def _gather(table, first, second, third, fourth, count, likelihood):
    # Not fastmath: the compiler would use gather instructions, which are slower than loads. Loads
    # are what this costs, so two particles' indices come in one word, the earlier in its low half.
    high = np.uint64(32)
    pairs = np.uint64(count) >> np.uint64(1)
    for pair in range(pairs):
        a, b, c, d = first[pair], second[pair], third[pair], fourth[pair]
        i = pair << np.uint64(1)
        likelihood[i] += (table[np.uint32(a)] + table[np.uint32(b)]) + (
            table[np.uint32(c)] + table[np.uint32(d)]
        )
        i += np.uint64(1)
        likelihood[i] += (table[a >> high] + table[b >> high]) + (
            table[c >> high] + table[d >> high]
        )
    if count % 2:
        a, b, c, d = first[pairs], second[pairs], third[pairs], fourth[pairs]
        likelihood[count - 1] += (table[np.uint32(a)] + table[np.uint32(b)]) + (
            table[np.uint32(c)] + table[np.uint32(d)]
        )


@kernel(_nrt=False, error_model="numpy")
def _gather_one(table, index, count, likelihood):
    for i in range(count):
        likelihood[i] += table[np.uint32(index[i])]


@kernel(_nrt=False, error_model="numpy")
def likelihood_field(table, rows, columns, cells, count, beams, kept, index, likelihood):
    """``1 + sum pz^3`` of ``count`` particles into ``likelihood`` (float32).

    ``table`` is the flat padded table of ``rows`` x ``columns``, ``cells`` the particles from
    ``to_cells``, ``beams`` the ``kept`` end points from ``beam_ends``, ``index`` int32 scratch
    ``(BEAMS_PER_PASS, capacity)``.
    """
    for i in range(count):
        likelihood[i] = np.float32(1.0)
    last_x = np.float32(columns - 0.5)
    last_y = np.float32(rows - 0.5)
    stride = np.int32(columns)
    x, y, cosine, sine = cells[0], cells[1], cells[2], cells[3]
    whole = kept - kept % BEAMS_PER_PASS
    room = min(index.shape[1], (count + 31) // 32 * 32)  # see belief.room_for
    pairs = index.view(np.uint64)  # little-endian, as all processors that numba knows
    for b in range(kept):
        lane = b % BEAMS_PER_PASS
        _index_beam(
            beams[0, b], beams[1, b], x, y, cosine, sine, room, stride, last_x, last_y, index[lane]
        )
        if b >= whole:
            _gather_one(table, index[lane], count, likelihood)
        elif lane == BEAMS_PER_PASS - 1:
            _gather(table, pairs[0], pairs[1], pairs[2], pairs[3], count, likelihood)
