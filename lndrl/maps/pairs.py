"""Pairs of boxes at a wanted distance, wherever a roadmap has points that far apart.

Boxes that are spread as far as they go (``regions``) may have no two at it: on a large floor all
lie farther apart, on a narrow or small one they lie too near. Origin (0, 0), metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.maps.paths import Roadmap, path_length
from lndrl.maps.regions import SMALLEST, centre, grow_box
from lndrl.randomness import fill_uniforms, stream_state
from lndrl.scenario import Box

_FAR = 3.0  # straight lines; the farthest that ways to a partner are searched at first
_AS_SHORT = 1.1  # ways at most this much longer than the shortest count as short
_SLACK = 0.1  # m
# Whole numbers: products of them order nodes alike on every machine.
_DIRECTIONS = [(4, k) for k in range(-3, 5)] + [(k, 4) for k in range(-4, 4)]
_SAMPLES = 1000  # pairs of points of two boxes
_FEWEST = 0.02  # of them at the distance, or such tasks are hard to draw

Floats = NDArray[np.float64]
Nodes = NDArray[np.intp]


@dataclass(frozen=True)
class Pair:
    """Two boxes with points at a wanted distance; ``detour``: way between them over distance."""

    start: Box
    goal: Box
    detour: float


def far_nodes(roadmap: Roadmap, part: int) -> tuple[Nodes, float]:
    """The outermost nodes of a connected part in many directions, and how far apart (m) they are.

    That distance is the part's largest, to within a percent.
    """
    members = np.flatnonzero(roadmap.part == part)
    nodes = roadmap.nodes[members]
    outermost: list[int] = []
    for right, up in _DIRECTIONS:
        along = right * nodes[:, 0] + up * nodes[:, 1]
        outermost += [int(np.argmin(along)), int(np.argmax(along))]
    found = members[list(dict.fromkeys(outermost))]
    at = roadmap.nodes[found]
    return found, float(np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)).max())


def wide_parts(roadmap: Roadmap, least: float) -> list[int]:
    """Numbers of the connected parts that may have nodes ``least`` m apart, the largest first."""
    count = int(roadmap.part.max(initial=-1)) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, roadmap.part, roadmap.nodes)
    np.maximum.at(high, roadmap.part, roadmap.nodes)
    return [int(part) for part in np.flatnonzero(np.hypot(*(high - low).T) >= least)]


def pair_boxes(
    roadmap: Roadmap, seeds: Nodes, limits: tuple[float, float], room: float, side: float, most: int
) -> list[Pair]:
    """Around each of the nodes ``seeds`` a box, and another at a distance within ``limits`` (m).

    The other is where the way is about as short as it gets, and far from the boxes before. No
    side is longer than ``side`` m, 0 for boxes of one point. Ends with ``most`` pairs of which
    each is nearly a straight way, or twice as many. Deterministic.
    """
    pairs: list[Pair] = []
    taken: list[Floats] = []
    for seed in seeds:
        start = grow_box(roadmap.distance, roadmap.resolution, roadmap.nodes[seed], room, side)
        found = _partner(roadmap, int(seed), centre(start), limits, room, side, taken)
        if found is None:
            continue
        node, detour = found
        goal = grow_box(roadmap.distance, roadmap.resolution, roadmap.nodes[node], room, side)
        if _share(start, goal, limits) < _FEWEST:
            continue
        pairs.append(Pair(start, goal, detour))
        taken += [centre(start), centre(goal)]
        if sum(pair.detour <= _AS_SHORT for pair in pairs) == most or len(pairs) == 2 * most:
            break
    return pairs


def _partner(
    roadmap: Roadmap,
    seed: int,
    middle: Floats,
    limits: tuple[float, float],
    room: float,
    side: float,
    taken: list[Floats],
) -> tuple[int, float] | None:
    """The node for the other box of a pair, and the detour of the way there; None: no such."""
    apart = np.hypot(*(roadmap.nodes - middle).T)
    half = 0.5 * (limits[1] - limits[0])
    off = np.abs(apart - (limits[0] + half))
    ring = (roadmap.part == roadmap.part[seed]) & (off <= half + 0.5 * side)
    ring[seed] = False
    roomy = ring & (roadmap.clear >= room + 0.5 * SMALLEST)
    ring = np.flatnonzero(roomy if roomy.any() else ring)
    if not len(ring):
        return None
    ring = ring[off[ring] <= max(0.5 * half, float(off[ring].min()) + _SLACK)]
    # On a large map a search of everything takes long, and longer ways are wanted by nobody.
    for limit in (_FAR * limits[1], np.inf):
        cost, before = roadmap.search(np.array([seed]), limit)
        if np.isfinite(cost[0, ring]).any():
            break
    ratio = cost[0, ring] / apart[ring]
    ring = ring[ratio <= _AS_SHORT * ratio.min()]
    gap = np.full(len(ring), np.inf)
    for other in (middle, *taken):
        gap = np.minimum(gap, np.hypot(*(roadmap.nodes[ring] - other).T))
    node = int(ring[np.argmax(gap)])
    way = path_length(roadmap.trace(before[0], node))
    return node, way / float(np.hypot(*(roadmap.nodes[node] - roadmap.nodes[seed])))


def _share(start: Box, goal: Box, limits: tuple[float, float]) -> float:
    """Share of the pairs of points of two boxes whose distance is within ``limits`` (m)."""
    drawn = np.empty(4 * _SAMPLES)
    fill_uniforms(stream_state(0), drawn)
    low, high = np.array([*start[:2], *goal[:2]]), np.array([*start[2:], *goal[2:]])
    points = low + (high - low) * drawn.reshape(-1, 4)
    apart = np.hypot(points[:, 2] - points[:, 0], points[:, 3] - points[:, 1])
    return float(((apart >= limits[0]) & (apart <= limits[1])).mean())
