"""The navigation task: observation, actions, reward, episodes, trajectories, Gymnasium."""

import gymnasium

from lndrl.navigation.actions import action_table
from lndrl.navigation.episode import EpisodeRecord, Outcome
from lndrl.navigation.navigation import Navigation, Transition, build_surroundings
from lndrl.navigation.observation import Observation, dequantise, quantise
from lndrl.navigation.pedestrian_map import draw_pedestrian_map, pedestrian_cells
from lndrl.navigation.render import render_snapshot
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.navigation.trajectory import Trajectory, final_indices
from lndrl.navigation.vector import StepResult, VectorNavigation

gymnasium.register(
    id="lndrl/Navigation-v0", entry_point="lndrl.navigation.environment:NavigationEnv"
)

__all__ = [
    "Navigation",
    "VectorNavigation",
    "StepResult",
    "Transition",
    "build_surroundings",
    "Observation",
    "quantise",
    "dequantise",
    "draw_pedestrian_map",
    "pedestrian_cells",
    "action_table",
    "REWARD_PARTS",
    "EpisodeRecord",
    "Outcome",
    "WorldSnapshot",
    "render_snapshot",
    "Trajectory",
    "final_indices",
]
