"""Names and bounds of the privileged floats; whoever learns needs no more of them.

The kernel beside this file writes them. All are bounded: lengths and angles are squashed by
sign(x) * log(1 + |x| / unit), shares of a weight by log(1 + share / unit), then everything is
clipped to +-LIMIT.
"""

from __future__ import annotations

POSE_UNIT = 0.1
"""m and rad: errors of a pose are squashed in tenths."""
MASS_UNIT = 0.01
"""Share of the particles' weight: a hundredth is seen clearly, where being lost begins."""
GOAL_UNIT = 1.0
"""m."""
LIMIT = 10.0
"""Of each float, both ways: 2 km in tenths of a metre."""

NAMES = (
    # The filter's pose now against the true one, in the true robot frame.
    "error_x",  # m, squashed
    "error_y",  # m, squashed
    "error_yaw",  # rad, squashed
    # The report that is heard against the truth that it is judged by (task.judged_moment).
    "judged_distance",  # m, squashed
    "judged_yaw",  # rad, unsigned, squashed
    # How the filter fares.
    "effective",  # log of the effective count over that of max_particles, 0 to 1
    "particles",  # log of the count over that of max_particles, 0 to 1
    "ratio",  # log(w_fast / w_slow), below 0 where scans fit worse than usual; 0 where cleared
    "cleared",  # 1 where both averages are 0: before the first update, after a burst
    "elsewhere",  # share of the weight outside the heaviest cluster, squashed
    "second_mass",  # share of the weight in the second cluster, squashed
    "second_distance",  # m from the heaviest to the second cluster, squashed; 0 without one
    "second_error",  # m from the truth to the second cluster, squashed; 0 without one
    # The goal in the true robot frame.
    "goal_x",  # m, squashed
    "goal_y",  # m, squashed
    # People beyond the pedestrian map.
    "unseen",  # log(1 + how many)
    "unseen_nearness",  # half of task.map_extent over the distance of the nearest; 0: nobody
    "unseen_approach",  # m/s with which the nearest comes nearer by itself
)
"""One float32 each, in this order: the K columns of ``privileged`` arrays."""
