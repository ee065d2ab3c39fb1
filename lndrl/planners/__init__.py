"""Anything that turns an observation into a velocity: the learned policy, and rules."""

from lndrl.planners.behaviour import behaviour_hash
from lndrl.planners.careful import CarefulConfig, CarefulPlanner
from lndrl.planners.careful_map import CarefulMapConfig, CarefulMapPlanner
from lndrl.planners.dwa import DWAConfig, DWAPlanner
from lndrl.planners.factory import (
    PlannerSource,
    has_weights,
    is_own_planner,
    is_rule,
    make_planner,
    planner_names,
    planner_source,
    takes_settings,
    teacher_of,
)
from lndrl.planners.guard import Guard, GuardConfig, GuardedPlanner
from lndrl.planners.interface import MapPlanner, Planner, episode_generator
from lndrl.planners.predictive import PredictiveConfig, PredictivePlanner
from lndrl.planners.shield import ShieldConfig, ShieldedPlanner
from lndrl.planners.simple import RandomPlanner, StraightPlanner

__all__ = [
    "CarefulConfig",
    "CarefulMapConfig",
    "CarefulMapPlanner",
    "CarefulPlanner",
    "DWAConfig",
    "DWAPlanner",
    "Guard",
    "GuardConfig",
    "GuardedPlanner",
    "MapPlanner",
    "Planner",
    "PlannerSource",
    "PredictiveConfig",
    "PredictivePlanner",
    "RandomPlanner",
    "ShieldConfig",
    "ShieldedPlanner",
    "StraightPlanner",
    "behaviour_hash",
    "episode_generator",
    "has_weights",
    "is_own_planner",
    "is_rule",
    "make_planner",
    "planner_names",
    "planner_source",
    "takes_settings",
    "teacher_of",
]
