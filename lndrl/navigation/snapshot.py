"""Everything that a drawing of one world needs, copied at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class WorldSnapshot:
    """One world and its belief at one moment; plain arrays, picklable, shares no memory.

    Map frame, metres, radians. ``outcome`` is empty while the episode goes on.
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
