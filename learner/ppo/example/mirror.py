"""What the robot would see and do in the world's mirror image: left is right.

Nothing in the task prefers a side, so whatever is known of a state is known of its mirror image.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.navigation import Observation, action_table

_SAME = 1e-9


def mirrored_actions(config: RunConfig) -> NDArray[np.int64] | None:
    """(A,) the action that is each one's mirror image; None where some action has none."""
    actions = action_table(config.task)
    images = actions * [1.0, -1.0]
    apart = np.abs(images[:, None] - actions[None]).max(axis=2)
    return None if (apart.min(axis=1) > _SAME).any() else apart.argmin(axis=1)


def mirror(observation: Observation, beams: int) -> Observation:
    """A copy of observations (..., ) with left and right exchanged; ``beams`` of one scan.

    Beam i at -fov/2 + i * fov / beams takes the place of beam ``beams`` - i. The first has no
    partner, as none looks at +fov/2 itself, and stays.
    """
    seen = observation.copy()
    scans = seen.scan.reshape(*seen.scan.shape[:-1], -1, beams)
    scans[..., 1:] = scans[..., :0:-1].copy()
    seen.pedestrians[..., 1] *= -1.0
    seen.pedestrians[..., 3] *= -1.0
    seen.goal[..., 1] *= -1.0
    seen.goal[..., 2] *= -1.0
    return seen
