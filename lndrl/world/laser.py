"""The simulated laser: true ranges to walls and legs, then the beam model's noise.

Source: Thrun et al., Probabilistic Robotics §6.3; weights of the paper. Bearings grow from
``-fov / 2`` by ``fov / beams``, so the last beam stops one increment short of ``+fov / 2``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import LaserConfig
from lndrl.kernels import kernel
from lndrl.maps.edges import (
    FaceScratch,
    RayMap,
    arctangent,
    faces_in_reach,
    make_face_scratch,
    scan_faces,
)
from lndrl.maps.raycast import cast_ray
from lndrl.randomness import State, fill_normals32, uniform

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

_FACES_PER_BEAM = 8  # a ray costs as much as drawing this many faces


class Fan(NamedTuple):
    """What kernels need of a laser; made once by ``make_fan``, never changed.

    ``cosines``, ``sines`` float64 ``(beams,)`` of the bearings; ``first`` bearing and
    ``increment`` (rad), ``range_max`` (m). Noise: cumulated weights ``z_max``, ``z_rand`` (with
    z_max) and ``z_other`` (with z_short); ``gap_scale`` = 1 / log(1 - z_other), for the number of
    true readings between two others; ``lambda_short`` (1/m), ``sigma_hit`` (m).
    """

    cosines: Floats
    sines: Floats
    first: float
    increment: float
    range_max: float
    z_max: float
    z_rand: float
    z_other: float
    gap_scale: float
    lambda_short: float
    sigma_hit: float


class ScanScratch(NamedTuple):
    """Working memory of the scan kernels, one per thread: true ranges (m) and normal draws,
    float32 ``(beams,)`` each, and what drawing faces needs.
    """

    ranges: Floats32
    normals: Floats32
    faces: FaceScratch


def beam_bearings(config: LaserConfig) -> Floats:
    """Bearing of every beam (rad, robot frame, counter-clockwise), ``(beams,)``."""
    increment = config.field_of_view / config.beams
    return -0.5 * config.field_of_view + increment * np.arange(config.beams, dtype=np.float64)


def make_fan(config: LaserConfig) -> Fan:
    """The configured laser for kernels."""
    bearings = beam_bearings(config)
    other = min(config.z_max + config.z_rand + config.z_short, 1.0)
    return Fan(
        cosines=np.cos(bearings),
        sines=np.sin(bearings),
        first=-0.5 * config.field_of_view,
        increment=config.field_of_view / config.beams,
        range_max=config.range_max,
        z_max=config.z_max,
        z_rand=config.z_max + config.z_rand,
        z_other=other,
        gap_scale=1.0 / np.log1p(-other) if 0.0 < other < 1.0 else 0.0,
        lambda_short=config.lambda_short,
        sigma_hit=config.sigma_hit,
    )


def make_scan_scratch(beams: int) -> ScanScratch:
    """Working memory for scans of up to ``beams`` beams."""
    ranges, normals = np.zeros((2, beams), np.float32)
    return ScanScratch(ranges, normals, make_face_scratch(beams))


class Laser:
    """Scans a place from the robot's base; lasers of one place share its ``rays``."""

    def __init__(self, config: LaserConfig, rays: RayMap) -> None:
        self.config = config
        self.bearings = beam_bearings(config)
        self.rays = rays
        self.fan = make_fan(config)
        self.scratch = make_scan_scratch(config.beams)

    def true_ranges(
        self, pose: Floats, legs: Floats, leg_radius: float, stride: int = 1
    ) -> Floats32:
        """Ranges without noise (m) of beams 0, stride, ...; ``legs`` is ``(L, 2)`` (m)."""
        out = np.empty(beams_of(self.config, stride), dtype=np.float32)
        trace(self.rays, self.fan, pose, legs, leg_radius, stride, self.scratch, out)
        return out

    def scan(
        self, pose: Floats, legs: Floats, leg_radius: float, state: State, stride: int = 1
    ) -> Floats32:
        """Noisy ranges (m, in [0, range_max]) of beams 0, stride, ...; advances ``state``."""
        out = np.empty(beams_of(self.config, stride), dtype=np.float32)
        noisy_scan(self.rays, self.fan, pose, legs, leg_radius, stride, state, self.scratch, out)
        return out


def beams_of(config: LaserConfig, stride: int) -> int:
    """How many beams 0, stride, 2 * stride, ... there are."""
    return (config.beams + stride - 1) // stride


@kernel(_nrt=False, error_model="numpy")
def noisy_scan(ray_map, fan, pose, legs, leg_radius, stride, state, scratch, out):
    """Fill ``out`` (m, float32, ``(n,)``) with readings of beams 0, stride, ..., n beams in all.

    ``pose`` [x, y, yaw] and ``legs`` ``(L, 2)`` float64 (m, rad, map frame); ``state`` uint64[4]
    advances. Deterministic in its arguments; allocates nothing. Beams that the fan does not have or
    ``scratch`` has no room for are left as they are.
    """
    n = _beams(fan, stride, scratch, out)
    ranges = scratch.ranges[:n]
    trace(ray_map, fan, pose, legs, leg_radius, stride, scratch, ranges)
    add_noise(ranges, fan, state, scratch.normals, out[:n])


@njit(inline="always")
def _beams(fan, stride, scratch, out):
    """How many of the beams that ``out`` asks for there are."""
    there = (len(fan.cosines) + stride - 1) // stride if stride > 0 else 0
    return min(len(out), there, len(scratch.ranges))


@kernel(_nrt=False, error_model="numpy")
def trace(ray_map, fan, pose, legs, leg_radius, stride, scratch, out):
    """Fill ``out`` with true ranges; arguments as for ``noisy_scan``.

    Walls are exact on the grid: 0 from within an occupied cell, ``range_max`` where nothing is
    hit or where the ray leaves the grid.
    """
    beams = out[: _beams(fan, stride, scratch, out)]
    trace_walls(ray_map, fan, pose, stride, scratch.faces, beams)
    trace_legs(fan, pose, legs, leg_radius, stride, beams)


@kernel(_nrt=False, error_model="numpy")
def trace_walls(ray_map, fan, pose, stride, scratch, out):
    """Ranges to walls, by the cheaper of two ways; both give the same ranges to 1e-4 m."""
    x = (pose[0] - ray_map.origin_x) * ray_map.inverse_resolution
    y = (pose[1] - ray_map.origin_y) * ray_map.inverse_resolution
    rows, columns = ray_map.cells.shape
    on_grid = 0.0 <= x < columns and 0.0 <= y < rows and np.isfinite(pose[2])
    if on_grid and ray_map.cells[int(y), int(x)] == 0:
        for k in range(len(out)):
            out[k] = np.float32(0.0)
        return
    limit = np.float32(fan.range_max)
    for k in range(len(out)):
        out[k] = limit
    if not on_grid:
        return
    faces = faces_in_reach(ray_map, x, y, fan.range_max * ray_map.inverse_resolution)
    if faces <= _FACES_PER_BEAM * len(out):
        scan_faces(ray_map, x, y, pose[2], fan, stride, scratch, out)
    else:
        scan_rays(ray_map, fan, pose, stride, out)


@kernel(_nrt=False, error_model="numpy")
def scan_rays(ray_map, fan, pose, stride, out):
    """Ranges to walls, ray by ray; from outside of the grid ``range_max``."""
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    for k in range(len(out)):
        u = fan.cosines[k * stride]
        v = fan.sines[k * stride]
        out[k] = cast_ray(
            ray_map.cells,
            ray_map.inverse_resolution,
            ray_map.origin_x,
            ray_map.origin_y,
            pose[0],
            pose[1],
            c * u - s * v,
            s * u + c * v,
            fan.range_max,
        )


@kernel(_nrt=False, error_model="numpy")
def trace_legs(fan, pose, legs, radius, stride, out):
    """Shorten the ranges of those beams that meet a leg; exact ray-circle intersection."""
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    farthest2 = (fan.range_max + radius) ** 2
    radius2 = radius * radius
    per_radian = 1.0 / (fan.increment * stride)
    whole = 2.0 * np.pi * per_radian
    per_turn = 1.0 / whole
    margin = 1e-2 + 2e-6 * per_radian
    for leg in range(len(legs)):
        dx = legs[leg, 0] - pose[0]
        dy = legs[leg, 1] - pose[1]
        x = c * dx + s * dy
        y = c * dy - s * dx
        distance2 = x * x + y * y
        if not distance2 < farthest2:
            continue
        if distance2 <= radius2:
            for k in range(len(out)):
                out[k] = np.float32(0.0)
            return
        half = arctangent(np.float32(radius), np.float32(np.sqrt(distance2 - radius2)))
        bearing = np.float64(arctangent(np.float32(y), np.float32(abs(x))))
        if x < 0.0:
            bearing = np.copysign(np.pi, y) - bearing
        middle = (bearing - fan.first) * per_radian
        width = half * per_radian + margin
        # A leg behind the robot may touch both ends of the fan.
        least = int(np.ceil((-width - middle) * per_turn))
        most = int(np.floor((len(out) - 1 + width - middle) * per_turn))
        for turns in range(least, most + 1):
            at = middle + turns * whole
            begin = max(0, int(np.ceil(at - width)))
            end = min(len(out) - 1, int(np.floor(at + width)))
            if begin <= end:
                _shorten(fan.cosines, fan.sines, x, y, radius2, stride, begin, end, out)


@kernel(_nrt=False, error_model="numpy")
def _shorten(cosines, sines, x, y, radius2, stride, begin, end, out):
    """Beams begin..end against one disc; indices without a sign, so that the loop vectorises."""
    first = np.uint64(begin)
    step = np.uint64(stride)
    for j in range(np.uint64(end - begin + 1)):
        k = first + j
        u = cosines[k * step]
        v = sines[k * step]
        along = u * x + v * y
        aside = u * y - v * x
        inside = radius2 - aside * aside
        at = np.float32(along - np.sqrt(inside if inside > 0.0 else 0.0))
        nearer = (inside >= 0.0) & (along > 0.0) & (at < out[k])
        out[k] = at if nearer else out[k]


@kernel(_nrt=False, error_model="numpy")
def add_noise(ranges, fan, state, normals, out):
    """Readings ``out`` of true ``ranges`` (m, float32, ``(n,)``; not the same array).

    A beam that meets nothing reports ``range_max`` without Gaussian noise: no echo has no
    distance. ``normals`` is working memory, float32, at least ``(n,)``.
    """
    n = min(len(out), len(ranges), len(normals))
    fill_normals32(state, normals[:n])
    limit = np.float32(fan.range_max)
    sigma = np.float32(fan.sigma_hit)
    for i in range(n):
        true = ranges[i]
        reading = true + sigma * normals[i]
        reading = reading if reading > np.float32(0.0) else np.float32(0.0)
        reading = reading if reading < limit else limit
        out[i] = reading if true < limit else limit
    if fan.z_other <= 0.0:
        return
    # Other readings are rare: draw how many beams lie between them, not one choice per beam.
    i = _gap(fan.gap_scale, state)
    while i < n:
        choice = uniform(state) * fan.z_other
        if choice < fan.z_max:
            out[i] = limit
        elif choice < fan.z_rand:
            out[i] = uniform(state) * fan.range_max
        else:
            # Exponential, cut at the true range: inverse of its distribution function.
            whole = 1.0 - np.exp(-fan.lambda_short * ranges[i])
            out[i] = -np.log(1.0 - uniform(state) * whole) / fan.lambda_short
        i += 1 + _gap(fan.gap_scale, state)


@kernel(_nrt=False, error_model="numpy")
def _gap(scale, state):
    """True readings before the next other one: geometric, by inversion; 0 for a scale of 0."""
    return np.int64(min(np.log(1.0 - uniform(state)) * scale, 1e15))
