"""The task as a Gymnasium environment: ``gymnasium.make("lndrl/Navigation-v0")``."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.localization import LikelihoodMap
from lndrl.navigation.actions import action_table
from lndrl.navigation.environment.arguments import (
    Configuration,
    episode_option,
    plain_spec,
    run_config,
    scale_factor,
    whole_number,
)
from lndrl.navigation.environment.render import render_snapshot
from lndrl.navigation.environment.spaces import (
    ObservationDict,
    observation_dict,
    observation_space,
    step_info,
)
from lndrl.navigation.navigation import Navigation, build_surroundings
from lndrl.world import Place

logger = logging.getLogger("lndrl")
_PLACES: WeakValueDictionary[str, Place] = WeakValueDictionary()
_FIELDS: WeakValueDictionary[str, LikelihoodMap] = WeakValueDictionary()
"""What environments that are alive were built in, by what they depend on."""


def shared_surroundings(config: RunConfig) -> tuple[Place, LikelihoodMap]:
    """``build_surroundings`` once for all environments of a process that are alive.

    Nothing writes there, and thirty-two maps in the caches of a core would be slower than one.
    The place's notes, which commands print, go to the log when it is built.
    """
    key = config.model_dump_json(include={"scenario", "world", "localization"})
    place, field = _PLACES.get(key), _FIELDS.get(key)
    if place is None or field is None:
        place, field = build_surroundings(config)
        _PLACES[key], _FIELDS[key] = place, field
        for note in place.notes:
            logger.warning("note: %s", note)
    return place, field


class NavigationEnv(gymnasium.Env[ObservationDict, np.int64]):
    """One world of the task.

    Observation: ``scan`` (frames, beams) in [0, 1] of range_max; ``pedestrians`` (3, cells, cells),
    see ``pedestrian_map``; ``goal`` (6,), see ``Observation``. Action: a number in the action
    table. ``info`` has ``reward_parts`` by name; at an end also ``outcome``, ``is_success`` and
    ``episode_record`` (a dict, whose sums ``reward_scale`` does not touch).

    A copy (``copy.deepcopy``, ``pickle``) is an environment of its own that goes on bit for bit
    as this one does.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    _spec: EnvSpec | None = None

    def __init__(
        self,
        config: Configuration | None = None,
        scenario: Path | str | None = None,
        world_id: int = 0,
        render_mode: str | None = None,
        reward_scale: float = 1.0,
    ) -> None:
        """``config``: a RunConfig, keys and values, or a YAML file, by default all defaults;
        ``scenario``: a name or a file, by default the configuration's, or else hybrid.
        ``reward_scale`` multiplies every reward.

        Raises UserError for a wrong file, key or name, ValueError for another wrong argument.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode must be rgb_array or None, not {render_mode!r}")
        self.config = run_config(config, scenario)
        self.reward_scale = scale_factor(reward_scale)
        self.render_mode = render_mode
        self.navigation = Navigation(
            *shared_surroundings(self.config), self.config, whole_number("world_id", world_id)
        )
        self._actions = action_table(self.config.task)
        self.action_space = spaces.Discrete(len(self._actions))
        self.observation_space = observation_space(  # type: ignore[assignment]
            self.config, self.navigation.place.grid.size
        )
        self._stream_from: np.random.Generator | None = None
        self._closed = False

    @property
    def spec(self) -> EnvSpec | None:
        """How the environment was made; its arguments are plain data."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = plain_spec(spec)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ObservationDict, dict[str, Any]]:
        """Start the next episode; ``seed`` starts that seed's stream of episodes at its first.

        An environment that never got a seed draws its stream from ``np_random``, as does one whose
        ``np_random`` was replaced. ``options={"episode": n}`` picks an episode of the stream
        instead of the next. ``info["episode_number"]`` says which, ``navigation.seed`` its stream.
        """
        self._refuse_if_closed()
        episode = episode_option(options)
        if seed is not None:
            seed = whole_number("seed", seed, most=None)
        super().reset(seed=seed)
        if seed is None and self.np_random is not self._stream_from:
            seed = int(self.np_random.integers(2**32))
        if seed is not None:
            self.navigation.seed = seed
            self.navigation.episode = -1
            self._stream_from = self.np_random
        self.navigation.reset(episode)
        return self._observation(), {"episode_number": self.navigation.episode}

    def step(
        self, action: np.int64 | int
    ) -> tuple[ObservationDict, float, bool, bool, dict[str, Any]]:
        """Take one control step.

        Raises ValueError for an action that is not in the table, ResetNeeded where no episode
        runs.
        """
        self._refuse_if_closed()
        if isinstance(action, bool) or not self.action_space.contains(action):
            raise ValueError(f"action must be in {self.action_space}, not {action!r}")
        if self.navigation.outcome:
            raise ResetNeeded("no episode runs; call reset() first")
        v, w = self._actions[action].tolist()
        transition = self.navigation.step(v, w)
        return (
            self._observation(),
            self.reward_scale * transition.reward,
            transition.terminated,
            transition.truncated,
            step_info(
                self.navigation.part_names, transition.parts, self.reward_scale, transition.record
            ),
        )

    def render(self) -> NDArray[np.uint8] | None:
        """The picture of the world (height, width, 3), or None without a render mode."""
        self._refuse_if_closed()
        if self.render_mode is None:
            return None
        if self.navigation.outcome == "unstarted":
            raise ResetNeeded("nothing to draw yet; call reset() first")
        return render_snapshot(self.navigation.snapshot())

    def close(self) -> None:
        """End the use of the environment; may be called again."""
        self._closed = True

    def _observation(self) -> ObservationDict:
        return observation_dict(self.navigation.observation, self.config.task)

    def _refuse_if_closed(self) -> None:
        if self._closed:
            raise ClosedEnvironmentError("the environment is closed; make another one")
