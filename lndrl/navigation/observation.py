"""What the policy sees: scan, people around, and the belief about where the goal lies.

Nothing here may depend on the true pose except through what sensors on the robot measure: the
goal comes from the estimated pose alone; people are measured relative to the robot.
Source: PAPER (state space), parameters §4.3 and §4.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import kernel

SCAN_COUNTS = 65535
"""Largest count of a scan on the wire; metres = counts * range_max / SCAN_COUNTS."""


@dataclass
class Observation:
    """Observations of many worlds or steps, one leading shape for all arrays: (B,), (T, B), ().

    scan: uint16 (..., beams), counts of range_max / 65535 metres, from -fov/2 to +fov/2. With
        ``task.scan_frames`` F above 1 (..., F * beams), scan by scan, the newest last; an episode
        begins with F times its first.
    pedestrians: float32 (..., max_pedestrians, 4): x, y (m), vx, vy (m/s) in the robot frame
        (rotated only), near to far, rows from ``pedestrian_count`` on are zero.
    pedestrian_count: uint8 (...).
    goal: float32 (..., 6): x, y (m, estimated robot frame), alpha (rad), and the variances of
        x, y (m^2) and yaw (rad^2), clipped to ``task.variance_limit``.
    """

    scan: NDArray[np.uint16]
    pedestrians: NDArray[np.float32]
    pedestrian_count: NDArray[np.uint8]
    goal: NDArray[np.float32]

    @classmethod
    def zeros(
        cls, shape: int | Sequence[int], max_pedestrians: int = 24, beams: int = 720
    ) -> Observation:
        """Zeroed arrays with the leading ``shape``."""
        lead = (shape,) if isinstance(shape, int) else tuple(shape)
        return cls(
            scan=np.zeros((*lead, beams), np.uint16),
            pedestrians=np.zeros((*lead, max_pedestrians, 4), np.float32),
            pedestrian_count=np.zeros(lead, np.uint8),
            goal=np.zeros((*lead, 6), np.float32),
        )

    @classmethod
    def zeros_for(cls, shape: int | Sequence[int], config: RunConfig) -> Observation:
        """Zeroed arrays in the sizes that ``config`` asks for."""
        beams = config.task.scan_frames * config.world.laser.beams
        return cls.zeros(shape, config.task.max_pedestrians, beams)

    @property
    def shape(self) -> tuple[int, ...]:
        """The leading shape."""
        return self.pedestrian_count.shape

    def __len__(self) -> int:
        return len(self.pedestrian_count)

    def take(self, index: Any) -> Observation:
        """Rows by any NumPy index over the leading axes; views where NumPy gives views."""
        return Observation(
            self.scan[index],
            self.pedestrians[index],
            self.pedestrian_count[index],
            self.goal[index],
        )

    def put(self, index: Any, rows: Observation) -> None:
        """Copy ``rows`` into the places that ``index`` names."""
        self.scan[index] = rows.scan
        self.pedestrians[index] = rows.pedestrians
        self.pedestrian_count[index] = rows.pedestrian_count
        self.goal[index] = rows.goal

    def copy(self) -> Observation:
        """A deep copy."""
        return Observation(
            self.scan.copy(),
            self.pedestrians.copy(),
            self.pedestrian_count.copy(),
            self.goal.copy(),
        )

    def reshape(self, *shape: int) -> Observation:
        """The same rows under another leading shape (-1 as in NumPy)."""
        lead = self.pedestrian_count.reshape(shape).shape
        return Observation(
            self.scan.reshape(*lead, *self.scan.shape[-1:]),
            self.pedestrians.reshape(*lead, *self.pedestrians.shape[-2:]),
            self.pedestrian_count.reshape(lead),
            self.goal.reshape(*lead, 6),
        )

    def flatten(self) -> Observation:
        """One leading axis: (T, B) becomes (T * B,), index t * B + b."""
        return self.reshape(-1)

    @staticmethod
    def concatenate(parts: Sequence[Observation]) -> Observation:
        """Join along the first leading axis; ``parts`` must not be empty."""
        return Observation(
            np.concatenate([p.scan for p in parts]),
            np.concatenate([p.pedestrians for p in parts]),
            np.concatenate([p.pedestrian_count for p in parts]),
            np.concatenate([p.goal for p in parts]),
        )


@kernel()
def quantise_scan(ranges, scale, out):
    """``quantise`` for kernels: ranges and out (n,), ``scale`` counts per metre."""
    for i in range(min(ranges.shape[0], out.shape[0])):
        count = np.float64(ranges[i]) * scale
        if count >= 0.0:
            # NaN fails this test and infinity the next: both read as no echo (parameters §4.2).
            out[i] = np.uint16(np.rint(count)) if count < 65534.5 else 65535
        elif count < 0.0:
            out[i] = 0
        else:
            out[i] = 65535


@kernel()
def push_scan(ranges, scale, begun, out):
    """Write a scan (n,) behind the newest of the scans in ``out`` (F * n,), the oldest leaves.

    Where ``begun`` is true, the scan takes the places of all.
    """
    beams = min(ranges.shape[0], out.shape[0])
    older = out.shape[0] - beams
    for k in range(older):
        out[k] = out[k + beams]
    quantise_scan(ranges, scale, out[older:])
    if begun and beams > 0:
        for k in range(older):
            out[k] = out[older + k % beams]


def quantise(
    ranges: NDArray[np.floating], range_max: float, out: NDArray[np.uint16] | None = None
) -> NDArray[np.uint16]:
    """Counts round(range * 65535 / range_max) of ranges in metres, any shape.

    Below 0 gives 0; above ``range_max``, infinity and NaN give 65535.
    """
    if out is None:
        out = np.empty(ranges.shape, np.uint16)
    quantise_scan(ranges.reshape(-1), SCAN_COUNTS / range_max, out.reshape(-1))
    return out


def dequantise(counts: NDArray[np.uint16], range_max: float) -> NDArray[np.float32]:
    """Metres (float32) of counts, any shape."""
    return counts * np.float32(range_max / SCAN_COUNTS)


@kernel()
def wrap_angle(angle):
    """``angle`` (rad) wrapped to [-pi, pi)."""
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped if wrapped < np.pi else -np.pi


@kernel()
def pedestrians_in_view(pose, position, velocity, extent, out):
    """Write the nearest people in view to ``out`` (M, 4), near to far; returns how many.

    ``pose`` (3,) of the sensor, ``position`` and ``velocity`` (P, 2) in the same frame. In view
    is |x| <= extent / 2 and |y| <= extent / 2 in the robot frame. Velocities are rotated only.
    Rows beyond the returned count are zeroed. Equal distances keep their order.
    """
    capacity = out.shape[0]
    half = 0.5 * extent
    cosine = np.cos(pose[2])
    sine = np.sin(pose[2])
    distance = np.empty(capacity + 1)
    count = 0
    if capacity == 0:
        return 0
    for i in range(position.shape[0]):
        dx = position[i, 0] - pose[0]
        dy = position[i, 1] - pose[1]
        x = np.float32(cosine * dx + sine * dy)
        y = np.float32(cosine * dy - sine * dx)
        if not (abs(x) <= half and abs(y) <= half):
            continue
        squared = dx * dx + dy * dy
        if count == capacity and squared >= distance[count - 1]:
            continue
        k = count if count < capacity else capacity - 1
        while k > 0 and distance[k - 1] > squared:
            distance[k] = distance[k - 1]
            out[k] = out[k - 1]
            k -= 1
        distance[k] = squared
        out[k, 0] = x
        out[k, 1] = y
        out[k, 2] = cosine * velocity[i, 0] + sine * velocity[i, 1]
        out[k, 3] = cosine * velocity[i, 1] - sine * velocity[i, 0]
        if count < capacity:
            count += 1
    out[count:] = 0.0
    return count


@kernel()
def goal_vector(pose_estimated, variance, goal, yaw_start, variance_limit, out):
    """Write the belief about the goal to ``out`` (6,): x, y, alpha, var_x, var_y, var_yaw.

    ``goal`` (2,) in the map frame goes into the estimated robot frame; the goal's yaw is the
    start yaw, so alpha = yaw_start - yaw_estimated, wrapped (parameters §4.4).
    """
    cosine = np.cos(pose_estimated[2])
    sine = np.sin(pose_estimated[2])
    dx = goal[0] - pose_estimated[0]
    dy = goal[1] - pose_estimated[1]
    out[0] = cosine * dx + sine * dy
    out[1] = cosine * dy - sine * dx
    out[2] = wrap_angle(yaw_start - pose_estimated[2])
    for i in range(3):
        # Written so that NaN, which full uncertainty may give, also reads as the limit.
        out[3 + i] = variance[i] if variance[i] < variance_limit else variance_limit
