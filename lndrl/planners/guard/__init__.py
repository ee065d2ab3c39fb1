"""The guard: which commands are safe, and a planner whose commands go through it."""

from lndrl.planners.guard.paths import Guard, GuardConfig, borne_out, explained
from lndrl.planners.guard.planner import GuardedPlanner

__all__ = ["Guard", "GuardConfig", "GuardedPlanner", "borne_out", "explained"]
