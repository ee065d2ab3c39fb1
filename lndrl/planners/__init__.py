"""Anything that turns an observation into a velocity: the learned policy, two floors, DWA."""

from lndrl.planners.dwa import DWAConfig, DWAPlanner
from lndrl.planners.factory import (
    PlannerSource,
    is_own_planner,
    is_rule,
    make_planner,
    planner_names,
    planner_source,
)
from lndrl.planners.interface import Planner, episode_generator
from lndrl.planners.simple import RandomPlanner, StraightPlanner

__all__ = [
    "DWAConfig",
    "DWAPlanner",
    "Planner",
    "PlannerSource",
    "RandomPlanner",
    "StraightPlanner",
    "episode_generator",
    "is_own_planner",
    "is_rule",
    "make_planner",
    "planner_names",
    "planner_source",
]
