"""The simulated laser: true ranges to walls and legs, then the beam model's noise.

Source: Thrun et al., Probabilistic Robotics §6.3; weights of the paper. Bearings grow from
``-fov / 2`` by ``fov / beams``, so the last beam stops one increment short of ``+fov / 2``.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lndrl.config import LaserConfig
from lndrl.maps.raycast import cast_ray
from lndrl.randomness import State, fill_normals, uniform

Floats = NDArray[np.float64]


def beam_bearings(config: LaserConfig) -> Floats:
    """Bearing of every beam (rad, robot frame, counter-clockwise), ``(beams,)``."""
    increment = config.field_of_view / config.beams
    return -0.5 * config.field_of_view + increment * np.arange(config.beams, dtype=np.float64)


class Laser:
    """Scans a place from the robot's base.

    ``cells`` is the map's ``clearance`` (uint8, origin (0, 0)) with cells of ``resolution``
    metres; lasers of one place share it.
    """

    def __init__(self, config: LaserConfig, cells: NDArray[np.uint8], resolution: float) -> None:
        self.config = config
        self.bearings = beam_bearings(config)
        self._cells = cells
        self._inverse_resolution = 1.0 / resolution
        self._cosines = np.cos(self.bearings)
        self._sines = np.sin(self.bearings)
        self._geometry = (
            config.range_max,
            -0.5 * config.field_of_view,
            config.field_of_view / config.beams,
        )
        self._noise = (
            config.z_max,
            config.z_max + config.z_rand,
            config.z_max + config.z_rand + config.z_short,
            config.lambda_short,
            config.sigma_hit,
        )

    def true_ranges(
        self, pose: Floats, legs: Floats, leg_radius: float, stride: int = 1
    ) -> NDArray[np.float32]:
        """Ranges without noise (m) of beams 0, stride, ...; ``legs`` is ``(L, 2)`` (m)."""
        out = np.empty((self.config.beams + stride - 1) // stride, dtype=np.float32)
        trace(
            self._cells,
            self._inverse_resolution,
            pose,
            legs,
            leg_radius,
            self._cosines,
            self._sines,
            self._geometry,
            stride,
            out,
        )
        return out

    def scan(
        self, pose: Floats, legs: Floats, leg_radius: float, state: State, stride: int = 1
    ) -> NDArray[np.float32]:
        """Noisy ranges (m, in [0, range_max]) of beams 0, stride, ...; advances ``state``."""
        out = np.empty((self.config.beams + stride - 1) // stride, dtype=np.float32)
        noisy_scan(
            self._cells,
            self._inverse_resolution,
            pose,
            legs,
            leg_radius,
            self._cosines,
            self._sines,
            self._geometry,
            stride,
            self._noise,
            state,
            out,
        )
        return out


@njit(cache=True, nogil=True)
def _trace_walls(cells, inverse_resolution, pose, cosines, sines, range_max, stride, out):
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    for k in range(len(out)):
        i = k * stride
        out[k] = cast_ray(
            cells,
            inverse_resolution,
            0.0,
            0.0,
            pose[0],
            pose[1],
            c * cosines[i] - s * sines[i],
            s * cosines[i] + c * sines[i],
            range_max,
        )


@njit(cache=True, nogil=True)
def _trace_legs(pose, legs, radius, cosines, sines, geometry, stride, out):
    """Shorten the ranges of those beams that meet a leg; exact ray-circle intersection."""
    range_max, first, increment = geometry
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    beams = len(cosines)
    for leg in range(len(legs)):
        dx = legs[leg, 0] - pose[0]
        dy = legs[leg, 1] - pose[1]
        x = c * dx + s * dy
        y = c * dy - s * dx
        distance2 = x * x + y * y
        if distance2 >= (range_max + radius) ** 2:
            continue
        if distance2 <= radius * radius:
            out[:] = 0.0
            return
        half = np.arcsin(radius / np.sqrt(distance2))
        bearing = np.arctan2(y, x)
        for turn in range(-1, 2):  # a leg behind the robot may touch both ends of the fan
            middle = bearing + turn * 2.0 * np.pi
            low = max(0, int(np.floor((middle - half - first) / increment)))
            high = min(beams - 1, int(np.ceil((middle + half - first) / increment)))
            k = (low + stride - 1) // stride
            while k * stride <= high:
                along = cosines[k * stride] * x + sines[k * stride] * y
                inside = radius * radius - (distance2 - along * along)
                if along > 0.0 and inside >= 0.0:
                    out[k] = min(out[k], along - np.sqrt(inside))
                k += 1


@njit(cache=True, nogil=True)
def trace(
    cells,
    inverse_resolution,
    pose,
    legs,
    leg_radius,
    cosines,
    sines,
    geometry,
    stride,
    out,
):
    """Fill ``out`` with true ranges; ``geometry`` = (range_max, first bearing, increment)."""
    _trace_walls(cells, inverse_resolution, pose, cosines, sines, geometry[0], stride, out)
    _trace_legs(pose, legs, leg_radius, cosines, sines, geometry, stride, out)


@njit(cache=True, nogil=True)
def add_noise(ranges, range_max, noise, state):
    """Replace true ranges by readings, in place.

    ``noise`` = (z_max, z_max + z_rand, z_max + z_rand + z_short, lambda_short, sigma_hit). A beam
    that meets nothing reports ``range_max`` without Gaussian noise: no echo has no distance.
    """
    normals = np.empty(len(ranges))
    fill_normals(state, normals)
    for i in range(len(ranges)):
        choice = uniform(state)
        if choice < noise[0]:
            ranges[i] = range_max
        elif choice < noise[1]:
            ranges[i] = uniform(state) * range_max
        elif choice < noise[2]:
            # Exponential, cut at the true range: inverse of its distribution function.
            whole = 1.0 - np.exp(-noise[3] * ranges[i])
            ranges[i] = -np.log(1.0 - uniform(state) * whole) / noise[3]
        elif ranges[i] < range_max:
            ranges[i] = min(max(ranges[i] + noise[4] * normals[i], 0.0), range_max)


@njit(cache=True, nogil=True)
def noisy_scan(
    cells,
    inverse_resolution,
    pose,
    legs,
    leg_radius,
    cosines,
    sines,
    geometry,
    stride,
    noise,
    state,
    out,
):
    """``trace`` and ``add_noise`` in one call."""
    _trace_walls(cells, inverse_resolution, pose, cosines, sines, geometry[0], stride, out)
    _trace_legs(pose, legs, leg_radius, cosines, sines, geometry, stride, out)
    add_noise(out, geometry[0], noise, state)
