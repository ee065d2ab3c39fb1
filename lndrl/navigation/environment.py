"""The task as a Gymnasium environment: ``gymnasium.make("lndrl/Navigation-v0")``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from lndrl.config import RunConfig, load_config, load_scenario
from lndrl.navigation.actions import action_table
from lndrl.navigation.navigation import Navigation, build_surroundings
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.navigation.pedestrian_map import draw_pedestrian_map
from lndrl.navigation.render import render_snapshot

ObservationDict = dict[str, NDArray[np.float32]]


class NavigationEnv(gymnasium.Env[ObservationDict, np.int64]):
    """One world of the task.

    Observation: ``scan`` (1, beams) in [0, 1] of range_max; ``pedestrians`` (3, cells, cells),
    see ``pedestrian_map``; ``goal`` (6,), see ``Observation``. Action: a number in the action
    table. ``info`` has the reward's parts, and ``episode_record`` (a dict) at an end.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        config: RunConfig | Path | str | None = None,
        scenario: str = "hybrid",
        world_id: int = 0,
        render_mode: str | None = None,
    ) -> None:
        """``config``: a RunConfig or a YAML file; without it, defaults in ``scenario``.

        Raises UserError for a wrong file or name, ValueError for an unknown render mode.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode must be rgb_array or None, not {render_mode!r}")
        if config is None:
            config = RunConfig(scenario=load_scenario(scenario))
        elif not isinstance(config, RunConfig):
            config = load_config(config)
        self.config = config
        self.render_mode = render_mode
        self.navigation = Navigation(*build_surroundings(config), config, world_id)
        self._actions = action_table(config.task)
        self.action_space = spaces.Discrete(len(self._actions))
        self.observation_space = _observation_space(config, self.navigation.place.grid.size)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObservationDict, dict[str, Any]]:
        """Start the next episode; ``seed`` starts that seed's stream of episodes at its first.

        ``options={"episode": n}`` picks an episode of the stream instead.
        """
        super().reset(seed=seed)
        episode = (options or {}).get("episode")
        if seed is not None:
            self.navigation.seed = seed
            episode = 0 if episode is None else episode
        self.navigation.reset(episode)
        return self._observation(), {"episode": self.navigation.episode}

    def step(
        self, action: np.int64 | int
    ) -> tuple[ObservationDict, float, bool, bool, dict[str, Any]]:
        """Take one control step."""
        if not self.action_space.contains(action):
            raise ValueError(f"action must be in {self.action_space}, not {action!r}")
        v, w = self._actions[action].tolist()
        transition = self.navigation.step(v, w)
        info: dict[str, Any] = {"reward_parts": transition.parts}
        if transition.record is not None:
            info["episode_record"] = transition.record.to_dict()
        return (
            self._observation(),
            transition.reward,
            transition.terminated,
            transition.truncated,
            info,
        )

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the world (height, width, 3), or None without a render mode."""
        if self.render_mode is None:
            return None
        return render_snapshot(self.navigation.snapshot())

    def _observation(self) -> ObservationDict:
        row = self.navigation.observation
        frames = self.config.task.scan_frames
        return {
            "scan": (row.scan.reshape(frames, -1) / SCAN_COUNTS).astype(np.float32),
            "pedestrians": draw_pedestrian_map(
                row.pedestrians, row.pedestrian_count, self.config.task
            ),
            "goal": row.goal.copy(),
        }


def _observation_space(
    config: RunConfig, size: tuple[float, float]
) -> spaces.Space[ObservationDict]:
    task = config.task
    # A lost estimate may leave the place by a little; ten times its extent is never reached.
    far = 10.0 * sum(size)
    speed = 10.0  # m/s, more than anybody walks
    low = np.full((3, task.map_cells, task.map_cells), -speed, np.float32)
    low[0] = 0.0
    high = np.full_like(low, speed)
    high[0] = 1.0
    limit = task.variance_limit
    return spaces.Dict(  # type: ignore[return-value]
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
