"""Many worlds as one Gymnasium vector environment, stepped together by compiled code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from lndrl.navigation.environment.arguments import (
    Configuration,
    episode_option,
    plain_spec,
    run_config,
    scale_factor,
    whole_number,
)
from lndrl.navigation.environment.render import render_snapshot
from lndrl.navigation.environment.single import NavigationEnv, shared_surroundings
from lndrl.navigation.environment.spaces import (
    ObservationDict,
    observation_dict,
    observation_space,
    step_info,
)
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.navigation.vector import StepResult, VectorNavigation

Step = tuple[
    ObservationDict,
    NDArray[np.float64],
    NDArray[np.bool_],
    NDArray[np.bool_],
    dict[str, Any],
]


class NavigationVectorEnv(
    gymnasium.vector.VectorEnv[ObservationDict, NDArray[np.integer], NDArray[Any]]
):
    """``num_envs`` worlds of one configuration, each as ``NavigationEnv`` is, bit for bit.

    A world that ends starts its next episode in the same step; what it showed last is in
    ``infos["final_obs"]``, what it told in ``infos["final_info"]``. One thread does all the work.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        **NavigationEnv.metadata,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    _spec: EnvSpec | None = None

    def __init__(
        self,
        num_envs: int = 1,
        config: Configuration | None = None,
        scenario: Path | str | None = None,
        world_id: int = 0,
        render_mode: str | None = None,
        reward_scale: float = 1.0,
    ) -> None:
        """Arguments and errors as for ``NavigationEnv``; all worlds have the same ``world_id``."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode must be rgb_array or None, not {render_mode!r}")
        if whole_number("num_envs", num_envs) == 0:
            raise ValueError("num_envs must be 1 or more")
        self.config = run_config(config, scenario)
        self.reward_scale = scale_factor(reward_scale)
        self.render_mode = render_mode
        self.num_envs = num_envs
        self.navigation = VectorNavigation(
            self.config, worlds=num_envs, surroundings=shared_surroundings(self.config)
        )
        for world in self.navigation.worlds:
            world.world_id = whole_number("world_id", world_id)
        size = self.navigation.worlds[0].place.grid.size
        self.single_observation_space = observation_space(self.config, size)
        self.single_action_space = spaces.Discrete(len(self.navigation.actions))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._begun = np.zeros(num_envs, np.bool_)
        self._has_stream = np.zeros(num_envs, np.bool_)
        self._stream_from: np.random.Generator | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """How the environment was made; its arguments are plain data."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = plain_spec(spec)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[ObservationDict, dict[str, Any]]:
        """Start the next episode in every world; see ``NavigationEnv.reset``.

        World i begins the stream ``seed`` + i, or seed[i]. ``options["reset_mask"]`` (num_envs,)
        bool says which worlds start, by default all.
        """
        self._refuse_if_closed()
        rest, chosen = self._masked(options)
        episode = episode_option(rest)
        seeds = self._seeds(seed)
        super().reset(seed=None if isinstance(seed, Sequence) else seeds[0])
        if seed is None and self.np_random is not self._stream_from:
            self._has_stream[:] = False
        infos: dict[str, Any] = {}
        for i in np.flatnonzero(chosen).tolist():
            world, stream = self.navigation.worlds[i], seeds[i]
            if stream is None and not self._has_stream[i]:
                stream = int(self.np_random.integers(2**32))
            if stream is not None:
                world.seed, world.episode = stream, -1
                self._has_stream[i] = True
            world.reset(episode)
            infos = self._add_info(infos, {"episode_number": world.episode}, i)
        self._stream_from = self.np_random
        self._begun |= chosen
        return self._observations(), infos

    def step(self, actions: NDArray[np.integer]) -> Step:
        """Take one control step in every world; ``actions`` (num_envs,) are numbers in the table.

        Raises ValueError for other actions, ResetNeeded before the first ``reset``.
        """
        self._refuse_if_closed()
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or not np.issubdtype(actions.dtype, np.integer):
            raise ValueError(f"actions must be in {self.action_space}, not {actions!r}")
        if not self._begun.all():
            raise ResetNeeded("no episode runs; call reset() first")
        result = self.navigation.step(actions)
        parts = result.parts
        ended = result.terminated | result.truncated
        infos: dict[str, Any] = {}
        if not ended.all():
            infos = {"reward_parts": self._parts_info(parts, ~ended), "_reward_parts": ~ended}
        if ended.any():
            self._tell_ends(result, np.flatnonzero(ended).tolist(), infos)
        # In the order in which kernel and own terms are added up: the same bits.
        built_in = len(REWARD_PARTS)
        rewards = parts[:, :built_in].sum(axis=1) + parts[:, built_in:].sum(axis=1)
        rewards *= self.reward_scale
        return self._observations(), rewards, result.terminated, result.truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture (height, width, 3) of every world, or None without a render mode."""
        self._refuse_if_closed()
        if self.render_mode is None:
            return None
        if not self._begun.all():
            raise ResetNeeded("nothing to draw yet; call reset() first")
        return tuple(render_snapshot(world.snapshot()) for world in self.navigation.worlds)

    def _observations(self) -> ObservationDict:
        return observation_dict(self.navigation.observation, self.config.task)

    def _parts_info(
        self, parts: NDArray[np.float64], going: NDArray[np.bool_]
    ) -> dict[str, NDArray[Any]]:
        """``parts`` (num_envs, parts) by name, 0 and masked where a world is not ``going`` on."""
        info: dict[str, NDArray[Any]] = {}
        for k, name in enumerate(self.navigation.worlds[0].part_names):
            info[name] = np.where(going, self.reward_scale * parts[:, k], 0.0)
            info[f"_{name}"] = going.copy()
        return info

    def _tell_ends(
        self,
        result: StepResult,
        ended: list[int],
        infos: dict[str, Any],
    ) -> None:
        for i, record in zip(ended, result.episodes, strict=True):
            last = observation_dict(result.final_observation.take((i, Ellipsis)), self.config.task)
            names = self.navigation.worlds[i].part_names
            info = step_info(names, result.parts[i], self.reward_scale, record)
            self._add_info(infos, {"final_obs": last, "final_info": info}, i)
            self._add_info(infos, {"episode_number": self.navigation.worlds[i].episode}, i)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if not isinstance(seed, Sequence):
            first = whole_number("seed", seed, most=None)
            return [first + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} worlds")
        return [None if s is None else whole_number("seed", s, most=None) for s in seed]

    def _masked(
        self, options: dict[str, Any] | None
    ) -> tuple[dict[str, Any] | None, NDArray[np.bool_]]:
        """The options without their ``reset_mask``, and the mask."""
        everyone = np.ones(self.num_envs, np.bool_)
        if not isinstance(options, Mapping) or "reset_mask" not in options:
            return options, everyone
        mask = options["reset_mask"]
        is_mask = isinstance(mask, np.ndarray) and mask.dtype == np.bool_
        if not is_mask or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] must be a bool array ({self.num_envs},) that is true "
                f"somewhere, not {mask!r}"
            )
        return {key: value for key, value in options.items() if key != "reset_mask"}, mask

    def _refuse_if_closed(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("the environment is closed; make another one")
