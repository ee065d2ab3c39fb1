"""Histogram of poses in a small hash table: counts KLD bins and carries the clusters' sums.

A bin is a box of ``bin_size`` x ``bin_size`` x ``bin_angle``. Headings wrap: the last bin of the
circle is the first one's neighbour. ROS never wraps a heading, so its bins run on past pi and only
random particles lie beyond the cut (navigation issue 27; docs/localization.md).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.config import LocalizationConfig
from lndrl.kernels import kernel

# key = (x bin << X_SHIFT) + (y bin << Y_SHIFT) + heading bin; bins may be negative.
Y_SHIFT = 12
X_SHIFT = 38
MAX_HEADINGS = (1 << Y_SHIFT) - 1
_HASH = np.uint64(0x9E3779B97F4A7C15)


class Bins(NamedTuple):
    """Occupied bins of one particle set; the first ``k`` entries of each column are in use."""

    slots: NDArray[np.int32]  # open-addressing table of bin numbers, -1 is empty
    slot: NDArray[np.int32]  # where in the table a bin stands
    used: NDArray[np.int32]  # (1,) bins in the table
    shift: int  # 64 - log2(len(slots))
    key: NDArray[np.int64]
    parent: NDArray[np.int32]  # union-find forest of the clusters
    sums: NDArray[np.float64]  # (5, capacity): mass, and mass times x, y, cos, sin
    size: float  # m
    angle: float  # rad
    headings: int  # bins around the circle


def make_bins(config: LocalizationConfig) -> Bins:
    """Empty bins with room for one bin per particle."""
    capacity = config.max_particles
    bits = max(4, math.ceil(math.log2(2 * capacity)))
    headings = min(max(1, round(2.0 * math.pi / config.bin_angle)), MAX_HEADINGS)
    return Bins(
        slots=np.full(1 << bits, -1, dtype=np.int32),
        slot=np.zeros(capacity, dtype=np.int32),
        used=np.zeros(1, dtype=np.int32),
        shift=64 - bits,
        key=np.zeros(capacity, dtype=np.int64),
        parent=np.zeros(capacity, dtype=np.int32),
        sums=np.zeros((5, capacity)),
        size=float(config.bin_size),
        # A whole number of equal bins, so that the circle closes.
        angle=2.0 * math.pi / headings,
        headings=headings,
    )


@kernel(_nrt=False, error_model="numpy")
def bin_key(x, y, yaw, bins):
    """Key of the bin that holds the pose (m, m, rad in [-pi, pi))."""
    column = np.int64(np.floor(x / bins.size))
    row = np.int64(np.floor(y / bins.size))
    heading = min(np.int64((yaw + math.pi) / bins.angle), bins.headings - 1)
    return (column << X_SHIFT) + (row << Y_SHIFT) + heading


@kernel(_nrt=False, error_model="numpy")
def bin_keys(particles, count, bins, keys):
    """Keys of ``count`` particles (rows x, y, yaw, ...) into ``keys`` (int64)."""
    for i in range(count):
        keys[i] = bin_key(particles[0, i], particles[1, i], particles[2, i], bins)


@kernel(_nrt=False, error_model="numpy")
def empty(bins):
    """Forget all bins; costs what they are, not what the table could hold."""
    for b in range(min(bins.used[0], bins.slot.size)):
        bins.slots[bins.slot[b]] = -1
    bins.used[0] = 0


@kernel(_nrt=False, error_model="numpy")
def find(key, bins):
    """Number of the bin with ``key``, -1 if there is none."""
    mask = bins.slots.size - 1
    slot = np.int64((np.uint64(key) * _HASH) >> np.uint64(bins.shift))
    while True:
        b = bins.slots[slot]
        if b < 0 or bins.key[b] == key:
            return b
        slot = (slot + 1) & mask


@kernel(_nrt=False, error_model="numpy")
def insert(key, bins, k):
    """Number of the bin with ``key``, made if there is none; and the number of bins, ``k`` or more.

    A new bin starts with empty sums. Where there is no room for one, the last takes its place.
    """
    mask = bins.slots.size - 1
    slot = np.int64((np.uint64(key) * _HASH) >> np.uint64(bins.shift))
    while True:
        b = bins.slots[slot]
        if b < 0:
            if k >= bins.key.size:
                return np.int32(k - 1), k
            bins.slots[slot] = k
            bins.slot[k] = slot
            bins.used[0] = k + 1
            bins.key[k] = key
            bins.parent[k] = k
            for row in range(5):
                bins.sums[row, k] = 0.0
            return np.int32(k), k + 1
        if bins.key[b] == key:
            return b, k
        slot = (slot + 1) & mask
