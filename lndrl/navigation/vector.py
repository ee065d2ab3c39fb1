"""Many worlds stepped together, each starting its next episode by itself when one ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.localization import LikelihoodMap
from lndrl.navigation.actions import action_table
from lndrl.navigation.batch import NavigationBatch
from lndrl.navigation.episode import EpisodeRecord
from lndrl.navigation.navigation import Navigation, build_surroundings
from lndrl.navigation.observation import Observation
from lndrl.navigation.privileged.floats import NAMES
from lndrl.navigation.privileged.kernel import know_worlds
from lndrl.navigation.track import RUNNING, TIMEOUT
from lndrl.navigation.training.retry import Retries
from lndrl.world import Place


@dataclass(slots=True)
class StepResult:
    """One step of B worlds.

    ``final_observation`` (B,) and ``final_privileged`` are reused by the next step; only rows whose
    world terminated or was truncated in this step are meaningful. The other arrays are new each
    step.
    """

    reward: NDArray[np.float32]  # (B,)
    terminated: NDArray[np.bool_]  # (B,)
    truncated: NDArray[np.bool_]  # (B,)
    final_observation: Observation
    episodes: list[EpisodeRecord]
    parts: NDArray[np.float64]  # (B, parts) the reward's summands, see ``Navigation.part_names``
    final_privileged: NDArray[np.float32] | None = (
        None  # (B, K), see ``VectorNavigation.privileged``
    )


class VectorNavigation:
    """B worlds with ids ``first_world``, ``first_world`` + 1, ...; shared place and field.

    World i plays episodes ``first_episode``, ``first_episode`` + 1, ... one after the other; what
    happens in one world never depends on the others. ``observation`` (B,) is rewritten in place
    by ``step``: copy what must outlive it. ``on_end``, when set, is called with a world that has
    just ended and its record, before that world starts its next episode.

    ``privileged`` float32 (B, K), likewise rewritten in place, is what only a critic may see of the
    state that is observed (``lndrl.navigation.privileged``); None unless it is asked for.

    A copy (``copy.deepcopy``, ``pickle``) has memory of its own and goes on bit for bit the same.
    """

    def __init__(
        self,
        config: RunConfig,
        first_world: int = 0,
        worlds: int = 1,
        first_episode: int = 0,
        surroundings: tuple[Place, LikelihoodMap] | None = None,
        privileged: bool = False,
    ) -> None:
        self.config = config
        self.first_episode = first_episode
        self.actions = action_table(config.task)
        self.observation = Observation.zeros_for(worlds, config)
        self.on_end: Callable[[Navigation, EpisodeRecord], None] | None = None
        self._final = Observation.zeros_for(worlds, config)
        if privileged:
            expect(know_worlds)
        self.privileged = np.zeros((worlds, len(NAMES)), np.float32) if privileged else None
        self._final_privileged = None if self.privileged is None else self.privileged.copy()
        place, field = surroundings or build_surroundings(config)
        # Where there are many layouts every world has a place, and so memory, of its own.
        self._batch: NavigationBatch | None = None
        if config.scenario.layouts is None:
            self._batch = NavigationBatch(place, field, config, worlds, self.observation)
        self.worlds = [
            Navigation(
                place,
                field,
                config,
                first_world + i,
                self.observation.take((i, Ellipsis)),
                self._batch,
                i,
            )
            for i in range(worlds)
        ]
        # What a second try ends in says nothing of how often episodes do: it has no record.
        self._retries = Retries(config.retry, self.worlds) if config.retry.most else None
        self.reset_all()

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        if self._batch is None:
            # Each world's own batch shows itself in a row of ours, which it has been parted from.
            for i, world in enumerate(self.worlds):
                world.show_in(self.observation.take(slice(i, i + 1)))

    def __len__(self) -> int:
        return len(self.worlds)

    def reset_all(self) -> None:
        """Start every world at ``first_episode`` again."""
        for i, world in enumerate(self.worlds):
            world.reset(self.first_episode)
            self._know(i)

    def step(self, actions: NDArray[np.integer]) -> StepResult:
        """Take action numbers (B,); raises ValueError when one is not in the table."""
        actions = np.asarray(actions)
        if actions.min() < 0 or actions.max() >= len(self.actions):
            raise ValueError(f"actions must be numbers from 0 to {len(self.actions) - 1}")
        return self.step_velocities(self.actions[actions])

    def step_velocities(self, velocities: NDArray[np.float64]) -> StepResult:
        """Take velocities (B, 2) v (m/s), w (rad/s); any values, not only the table's."""
        number = len(self.worlds)
        if velocities.shape != (number, 2):
            raise ValueError(f"expected commands for {number} worlds, not {velocities.shape}")
        self._run(np.ascontiguousarray(velocities, dtype=np.float64))
        if self._retries is not None:
            self._retries.cut()
        reward, outcome = self._judged()
        result = StepResult(
            reward=reward.astype(np.float32),
            terminated=(outcome != RUNNING) & (outcome != TIMEOUT),
            truncated=outcome == TIMEOUT,
            final_observation=self._final,
            episodes=[],
            parts=self._parts(),
            final_privileged=self._final_privileged,
        )
        for i in np.flatnonzero(outcome).tolist():
            self._end(i, result)
        if self._retries is not None:
            self._retries.remember()
        return result

    def _run(self, commands: NDArray[np.float64]) -> None:
        """One control step of all worlds, in one go where they share a place."""
        if self._batch is not None:
            self._batch.drive(commands)
            self._batch.judge()
            if self.privileged is not None:
                self._batch.know(self.privileged)
            return
        for i, world in enumerate(self.worlds):
            world.batch.drive(commands[i : i + 1])
            world.batch.judge()
            self._know(i)

    def _know(self, i: int) -> None:
        """Write the privileged floats of world ``i``, where they are asked for."""
        if self.privileged is not None:
            world = self.worlds[i]
            world.batch.know(self.privileged[i : i + 1], world.index)

    def _judged(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Rewards and outcomes (B,) of the last step; views where the worlds share memory."""
        if self._batch is not None:
            tracks = self._batch.tracks
            return tracks.reward[:, 0], tracks.outcome[:, 0]
        return (
            np.array([world.track.reward[0] for world in self.worlds]),
            np.array([world.track.outcome[0] for world in self.worlds]),
        )

    def _parts(self) -> NDArray[np.float64]:
        if self._batch is not None and self._batch.terms is None:
            return self._batch.tracks.parts.copy()
        return np.stack([world.parts() for world in self.worlds])

    def _end(self, i: int, result: StepResult) -> None:
        """Write down world ``i``'s episode, which has ended, and start its next one."""
        world = self.worlds[i]
        if self._retries is None or not self._retries.trying(i):
            record = world.record()
            result.episodes.append(record)
            if self.on_end is not None:
                self.on_end(world, record)
        self._final.put(i, world.observation)
        if self.privileged is not None and self._final_privileged is not None:
            self._final_privileged[i] = self.privileged[i]
        if self._retries is None or not self._retries.go_back(i):
            world.reset()
        self._know(i)
