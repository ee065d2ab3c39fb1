"""The 28 actions: pairs of linear and angular velocity (PAPER, action space)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import TaskConfig


def action_table(task: TaskConfig) -> NDArray[np.float64]:
    """Velocities (A, 2): v (m/s) in the outer, w (rad/s) in the inner loop, both ascending.

    The order is that of the group's code (parameters §4.1); index 3 is (0, 0), standing still.
    """
    return np.array(
        [(v, w) for v in sorted(task.linear_velocities) for w in sorted(task.angular_velocities)],
        dtype=np.float64,
    )
