"""Observations as Gymnasium sees them: float32 arrays by name, and the spaces they live in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lndrl.config import RunConfig, TaskConfig
from lndrl.navigation.episode import EpisodeRecord
from lndrl.navigation.observation import SCAN_COUNTS, Observation
from lndrl.navigation.pedestrian_map import draw_pedestrian_map

ObservationDict = dict[str, NDArray[np.float32]]


def observation_space(config: RunConfig, size: tuple[float, float]) -> spaces.Dict:
    """Of one world in a place of ``size`` (m)."""
    task = config.task
    # A lost estimate may leave the place by a little; ten times its extent is never reached.
    far = 10.0 * sum(size)
    speed = 10.0  # m/s, more than anybody walks
    low = np.full((3, task.map_cells, task.map_cells), -speed, np.float32)
    low[0] = 0.0
    high = np.full_like(low, speed)
    high[0] = 1.0
    limit = task.variance_limit
    return spaces.Dict(
        {
            "scan": spaces.Box(0.0, 1.0, (task.scan_frames, config.world.laser.beams), np.float32),
            "pedestrians": spaces.Box(low, high, dtype=np.float32),
            "goal": spaces.Box(
                np.array([-far, -far, -np.pi, 0, 0, 0], np.float32),
                np.array([far, far, np.pi, limit, limit, limit], np.float32),
                dtype=np.float32,
            ),
        }
    )


def observation_dict(rows: Observation, task: TaskConfig) -> ObservationDict:
    """``rows`` () or (B,) as their space has them, in new arrays."""
    return {
        "scan": np.divide(
            rows.scan.reshape(*rows.shape, task.scan_frames, -1), SCAN_COUNTS, dtype=np.float32
        ),
        "pedestrians": draw_pedestrian_map(rows.pedestrians, rows.pedestrian_count, task),
        "goal": rows.goal.copy(),
    }


def step_info(
    names: Sequence[str], parts: NDArray[np.float64], scale: float, record: EpisodeRecord | None
) -> dict[str, Any]:
    """``info`` of a step that earned ``parts`` with these ``names``, times ``scale``, and ended an
    episode where it has a ``record``.
    """
    info: dict[str, Any] = {"reward_parts": dict(zip(names, (scale * parts).tolist(), strict=True))}
    if record is not None:
        info["outcome"] = record.outcome
        info["is_success"] = record.outcome == "arrived"
        info["episode_record"] = record.to_dict()
    return info
