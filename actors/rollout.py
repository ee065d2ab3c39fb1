"""Collecting one chunk: T control steps of B worlds under one set of weights.

The loop of the actor service is ``Rollout.collect``; what goes over the wire is the schema of
``lndrl.navigation.trajectory``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from lndrl.config import RunConfig
from lndrl.navigation import (
    EpisodeRecord,
    Observation,
    StepResult,
    Trajectory,
    VectorNavigation,
    build_surroundings,
    final_indices,
)
from lndrl.policy import PolicyRunner
from lndrl.randomness import Stream

WORLDS_PER_ACTOR = 100_000  # world ids actor_index * this + i are distinct among all actors


@dataclass(frozen=True)
class Chunk:
    """What one call of ``Rollout.collect`` yields.

    ``seconds`` splits its wall time: ``simulate`` (worlds, AMCL, reward) and ``infer`` (policy).
    """

    trajectory: Trajectory
    episodes: list[EpisodeRecord]
    seconds: dict[str, float]


class Rollout:
    """B worlds and the policy that drives them.

    ``actor_index`` decides the world ids and the action noise, ``first_episode`` numbers every
    world's first episode; ``worlds`` (B) defaults to ``config.actor.worlds``, the chunk length
    T is ``config.actor.horizon``. Raises UserError when the scenario cannot be built.
    """

    def __init__(
        self,
        config: RunConfig,
        actor_index: int,
        worlds: int | None = None,
        first_episode: int = 0,
        device: str = "cpu",
    ) -> None:
        self.config = config
        self.actor_index = actor_index
        self.steps = config.actor.horizon
        self.worlds = worlds or config.actor.worlds
        self.version = -1  # no weights yet
        surroundings = build_surroundings(config)
        self.environment = VectorNavigation(
            config, actor_index * WORLDS_PER_ACTOR, self.worlds, first_episode, surroundings
        )
        self.runner = PolicyRunner(config, device=device)
        # Compile every kernel now, on a world that nobody records.
        scratch = VectorNavigation(config, 0, 1, surroundings=surroundings)
        self.runner.act(scratch.observation, np.random.default_rng(0))
        scratch.step(np.zeros(1, np.uint8))

    def load(self, version: int, blob: bytes) -> None:
        """Act on weights ``version`` (safetensors bytes) from now on."""
        self.runner.load(blob)
        self.version = version

    def action_generator(self, number: int) -> np.random.Generator:
        """Noise of chunk ``number``: a function of (seed, actor, chunk), so that runs repeat."""
        path = (self.actor_index, number, int(Stream.POLICY))
        return np.random.default_rng(np.random.SeedSequence(self.config.seed, spawn_key=path))

    def collect(self, number: int, stopped: Callable[[], bool] = bool) -> Chunk | None:
        """Play T steps in every world and record them; None once ``stopped()`` is true.

        ``number`` selects the action noise. Worlds that end restart by themselves. A state that
        the learner must value to bootstrap (after a truncated step, and after the last step of
        a world that goes on) is kept as a final observation, in ascending index t * B + b.
        """
        steps, worlds, environment = self.steps, self.worlds, self.environment
        generator = self.action_generator(number)
        # Fresh arrays for every chunk: the last one may still be on its way to the learner.
        observation = Observation.zeros_for((steps, worlds), self.config)
        action = np.zeros((steps, worlds), np.uint8)
        log_prob, reward = np.zeros((2, steps, worlds), np.float32)
        terminated, truncated = np.zeros((2, steps, worlds), np.uint8)
        finals = [Observation.zeros_for(0, self.config)]
        episodes: list[EpisodeRecord] = []
        seconds = {"simulate": 0.0, "infer": 0.0}

        for t in range(steps):
            if stopped():
                return None
            observation.put(t, environment.observation)
            begun = perf_counter()
            action[t], log_prob[t] = self.runner.act(environment.observation, generator)
            decided = perf_counter()
            result = environment.step(action[t])
            seconds["infer"] += decided - begun
            seconds["simulate"] += perf_counter() - decided
            reward[t] = result.reward
            terminated[t], truncated[t] = result.terminated, result.truncated
            episodes.extend(result.episodes)
            needed = ~result.terminated if t == steps - 1 else result.truncated
            if needed.any():
                finals.append(following(environment.observation, result).take(needed))

        trajectory = Trajectory(
            observation=observation,
            action=action,
            log_prob=log_prob,
            reward=reward,
            terminated=terminated,
            truncated=truncated,
            version=np.full((steps, worlds), self.version, np.uint32),
            final_index=final_indices(terminated, truncated),
            final_observation=Observation.concatenate(finals),
        )
        return Chunk(trajectory, episodes, seconds)


def following(current: Observation, result: StepResult) -> Observation:
    """The observation (B) that each step led to, before any restart (terminated rows are void).

    ``current`` is the environment's observation after the step, where a truncated world has
    already begun its next episode.
    """
    rows = current.copy()
    rows.put(result.truncated, result.final_observation.take(result.truncated))
    return rows
