"""Everything that a drawing of one world needs, copied at one moment."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


def _zeros(*shape: int) -> Callable[[], NDArray[np.float64]]:
    return lambda: np.zeros(shape)


@dataclass(frozen=True)
class WorldSnapshot:
    """One world and its belief at one moment; plain arrays, picklable, shares no memory.

    Map frame, metres, radians. ``outcome`` is empty while the episode goes on. What has a default
    is not known of walks that others have recorded.
    """

    scenario: str
    size: tuple[float, float]  # width and height of the place
    occupied: NDArray[np.bool_]  # (rows, columns), row 0 at the lowest y
    resolution: float
    origin: tuple[float, float]  # lower left corner of cell (0, 0)
    world: int
    episode: int
    steps: int
    time: float
    outcome: str
    pose_true: NDArray[np.float64]  # (3,)
    pose_estimated: NDArray[np.float64]  # (3,)
    variance: NDArray[np.float64]  # (3,) of x, y, yaw, unclipped
    particles: NDArray[np.float64]  # (n, 3)
    start_pose: NDArray[np.float64]  # (3,)
    goal: NDArray[np.float64]  # (2,)
    arrive_distance: float
    command: NDArray[np.float64]  # (2,) v, w
    scan: NDArray[np.float32]  # (beams,) as the policy sees it
    field_of_view: float
    range_max: float
    pedestrian_position: NDArray[np.float64]  # (P, 2)
    pedestrian_velocity: NDArray[np.float64]  # (P, 2)
    leg_position: NDArray[np.float64]  # (2P, 2)
    pedestrian_radius: float
    leg_radius: float
    robot_radius: float
    path: NDArray[np.float64]  # (k, 2) true positions, one per control step
    path_estimated: NDArray[np.float64]  # (k, 2)
    episode_return: float
    pose_odometry: NDArray[np.float64] = field(default_factory=_zeros(3))
    """Odom frame, which begins at ``start_pose``"""
    covariance: NDArray[np.float64] = field(default_factory=_zeros(3, 3))
    """Of x, y, yaw over all particles"""
    weights: NDArray[np.float64] = field(default_factory=_zeros(0))  # (n,) of the particles, sum 1
    clusters: NDArray[np.float64] = field(default_factory=_zeros(2, 3))
    """Share of the weight, x, y; the heaviest first"""
    position_error: float = 0.0  # m, of the estimate that is heard; both as they are judged
    angle_error: float = 0.0  # rad
    lost_distance: float = math.inf  # m; farther off is lost
    lost_angle: float = math.inf  # rad
    part_names: tuple[str, ...] = ()
    parts: NDArray[np.float64] = field(default_factory=_zeros(0))
    """(len(part_names),) reward of the last control step"""
    actions: NDArray[np.float64] = field(default_factory=_zeros(0, 2))
    """(A, 2) v (m/s), w (rad/s) to choose from"""
    probabilities: NDArray[np.float64] = field(default_factory=_zeros(0))
    """(A,) of the last choice; () of a rule"""
    action: int = -1  # the one that was taken; -1 where none was
