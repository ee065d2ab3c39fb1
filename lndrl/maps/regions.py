"""Boxes of free floor spread over a map, to start from and to go to. Origin (0, 0), metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.maps.paths import Roadmap
from lndrl.scenario import Box

SMALLEST = 0.5  # m, side of a box; smaller ones are left out where there are others
_GROWTH = 0.1  # m added to a side at a time

Floats = NDArray[np.float64]


def spread_boxes(
    roadmap: Roadmap, room: float, count: int, side: float, part: int = 0
) -> list[Box]:
    """Up to ``count`` boxes, no side longer than ``side`` m, far from each other.

    They lie in a connected ``part`` of the roadmap, by default the largest; every point of them
    keeps ``room`` m to the walls. Each is grown around the node that lies farthest from the boxes
    before it, so that they reach every corner. Deterministic.
    """
    open_ = np.flatnonzero((roadmap.part == part) & (roadmap.clear >= room + 0.5 * SMALLEST))
    nodes, clear = roadmap.nodes[open_], roadmap.clear[open_]
    boxes: list[Box] = []
    if not len(nodes):
        return boxes
    # The first where there is most room, farther ones then where they are farthest.
    far = np.full(len(nodes), np.inf)
    pick = int(np.argmax(clear))
    while len(boxes) < count and far[pick] > SMALLEST:
        seed = nodes[pick]
        box = grow_box(roadmap.distance, roadmap.resolution, seed, room, side)
        if min(box[2] - box[0], box[3] - box[1]) >= SMALLEST:
            boxes.append(box)
        centre = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
        for point in (seed, centre):
            far = np.minimum(far, np.hypot(*(nodes - point).T))
        pick = int(np.argmax(far))
    return boxes


def grow_box(
    distance: NDArray[np.float32],
    resolution: float,
    seed: NDArray[np.float64],
    room: float,
    side: float,
) -> Box:
    """The box around ``seed`` (m) that grows on all sides in turn while it keeps ``room`` m.

    Corners are multiples of a centimetre inside it, so that they read well in a file; with a
    ``side`` of 0 it is the seed's cell's centre alone.
    """
    need = room + 0.5 * resolution
    column, row = (int(v / resolution) for v in seed)
    low_c, low_r, high_c, high_r = column, row, column, row  # inclusive
    most = max(1, int(side / resolution))
    step = max(1, round(_GROWTH / resolution))
    rows, columns = distance.shape
    growing = [True] * 4
    while any(growing):
        for edge, (dc0, dr0, dc1, dr1) in enumerate(
            ((-step, 0, 0, 0), (0, -step, 0, 0), (0, 0, step, 0), (0, 0, 0, step))
        ):
            c0, r0, c1, r1 = low_c + dc0, low_r + dr0, high_c + dc1, high_r + dr1
            fits = (
                min(c0, r0) >= 0
                and c1 < columns
                and r1 < rows
                and max(c1 - c0, r1 - r0) < most
                and bool((distance[r0 : r1 + 1, c0 : c1 + 1] >= need).all())
            )
            growing[edge] = growing[edge] and fits
            if growing[edge]:
                low_c, low_r, high_c, high_r = c0, r0, c1, r1
    # From cell centre to cell centre: there the field is what it says.
    first, last = np.array([low_c, low_r]) + 0.5, np.array([high_c, high_r]) + 0.5
    low = np.ceil(first * resolution * 100 - 1e-6) / 100
    high = np.floor(last * resolution * 100 + 1e-6) / 100
    # No such multiple within: a point, and off its cell's centre it would be nearer to a wall.
    low = np.where(high < low, 0.5 * (first + last) * resolution, low)
    high = np.maximum(low, high)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def centre(box: Box) -> Floats:
    """Middle (x, y) of a box (m)."""
    return 0.5 * (np.array(box[:2]) + np.array(box[2:]))
