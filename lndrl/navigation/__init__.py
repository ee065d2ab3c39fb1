"""The navigation task: observation, actions, reward, episodes, trajectories, Gymnasium.

What simulates is imported when it is first asked for: a learner needs the data alone, and is back
sooner after a crash.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from lndrl.navigation.actions import action_table
from lndrl.navigation.episode import EpisodeRecord, Outcome
from lndrl.navigation.observation import Observation, dequantise, quantise
from lndrl.navigation.pedestrian_map import draw_pedestrian_map, pedestrian_cells
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.navigation.trajectory import Trajectory, final_indices

if TYPE_CHECKING:
    from lndrl.navigation.environment.render import render_snapshot
    from lndrl.navigation.navigation import Navigation, Transition, build_surroundings
    from lndrl.navigation.snapshot import WorldSnapshot
    from lndrl.navigation.vector import StepResult, VectorNavigation

_SIMULATION = {
    "Navigation": "navigation",
    "Transition": "navigation",
    "build_surroundings": "navigation",
    "render_snapshot": "environment.render",
    "WorldSnapshot": "snapshot",
    "StepResult": "vector",
    "VectorNavigation": "vector",
}
"""Where the names are that come late."""

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


def __getattr__(name: str) -> Any:
    if name not in _SIMULATION:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_SIMULATION[name]}"), name)
