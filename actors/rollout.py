"""Collecting one chunk: T control steps of B worlds under one set of weights.

The loop of the actor service is ``Rollout.collect``; what goes over the wire is the schema of
``lndrl.navigation.trajectory``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors import teaching
from actors.laps import Laps
from actors.showing import Showing
from actors.teaching import Teacher
from actors.witness import Witness
from lndrl.config import RunConfig
from lndrl.kernels import expect
from lndrl.navigation import (
    EpisodeRecord,
    Navigation,
    Observation,
    StepResult,
    Trajectory,
    VectorNavigation,
    build_surroundings,
    final_indices,
)
from lndrl.navigation.batch import KERNELS
from lndrl.navigation.families import first_world_of_actor
from lndrl.navigation.privileged.kernel import know_worlds
from lndrl.policy import Guidance, PolicyRunner
from lndrl.randomness import Stream


@dataclass(frozen=True)
class Chunk:
    """What one call of ``Rollout.collect`` yields."""

    trajectory: Trajectory
    episodes: list[EpisodeRecord]


class Rollout:
    """B worlds and the policy that drives them.

    ``actor_index`` decides the world ids and the action noise, ``first_episode`` numbers every
    world's first episode; ``worlds`` (B) defaults to ``config.worlds_per_actor()``, the chunk
    length T is ``config.actor.horizon``. ``laps`` hears how long worlds (``simulate``) and policy
    (``infer``) take. Raises UserError when the scenario cannot be built.
    """

    def __init__(
        self,
        config: RunConfig,
        actor_index: int,
        worlds: int | None = None,
        first_episode: int = 0,
        device: str = "cpu",
        laps: Laps | None = None,
    ) -> None:
        self.config = config
        self.laps = laps or Laps()
        self.actor_index = actor_index
        self.steps = config.actor.horizon
        self.worlds = worlds or config.worlds_per_actor()
        self.version = -1  # no weights yet
        # The policy's first ones are compiled before there is a world.
        expect(*KERNELS, *((know_worlds,) if config.learner.privileged_critic else ()))
        expect(*(teaching.KERNELS if config.ppo.teacher is not None else ()))
        self.runner = PolicyRunner(config, device, config.actor.precision == "bfloat16")
        surroundings = build_surroundings(config)
        self.environment = VectorNavigation(
            config,
            first_world_of_actor(actor_index),
            self.worlds,
            first_episode,
            surroundings,
            config.learner.privileged_critic,
        )
        self.showing: Showing | None = None
        self.guidance = Guidance()
        self.teacher = None if config.ppo.teacher is None else Teacher(config, self.worlds)
        # Compile every kernel now, on a world that nobody records.
        scratch = VectorNavigation(config, 0, 1, surroundings=surroundings)
        self.runner.act(scratch.observation, np.random.default_rng(0))
        scratch.step(np.zeros(1, np.uint8))
        if config.ppo.teacher is not None:
            taught = Teacher(config, 1)
            taught.begin(1, Guidance(labels=True), np.random.default_rng(0))
            taught.teach(0, scratch.observation)

    def load(self, version: int, blob: bytes) -> None:
        """Act on weights ``version`` (safetensors bytes) from now on."""
        self.runner.load(blob)
        self.guidance = Guidance.of(blob)
        self.version = version

    def show_on(self, showing: Showing) -> None:
        """Let whoever watches see the first world from now on."""
        self.showing = showing
        first = self.environment.worlds[0]

        def ended(world: Navigation, record: EpisodeRecord) -> None:
            if world is first:
                showing.ended(world, self.version)

        self.environment.on_end = ended

    def _show(self) -> None:
        """Show the first world after a step, where somebody watches and it is time."""
        if self.showing is not None and self.showing.wanted():
            world = self.environment.worlds[0]
            self.showing.see(world, np.exp(self.runner.said[0]), self.version)

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
        witness = Witness(environment, steps)
        if self.teacher is not None:
            self.teacher.begin(steps, self.guidance, generator)

        for t in range(steps):
            if stopped():
                return None
            observation.put(t, environment.observation)
            witness.see(t)
            self.laps.lap("other")
            given = self.teacher.teach(t, environment.observation) if self.teacher else None
            act = self.runner.act(environment.observation, generator, given=given)
            action[t], log_prob[t] = act
            self.laps.lap("infer")
            result = environment.step(action[t])
            if self.teacher is not None:
                self.teacher.told(action[t], result.terminated | result.truncated)
            self.laps.lap("simulate")
            reward[t] = result.reward
            terminated[t], truncated[t] = result.terminated, result.truncated
            episodes.extend(result.episodes)
            self._show()
            needed = ~result.terminated if t == steps - 1 else result.truncated
            if needed.any():
                finals.append(following(environment.observation, result, needed))
                witness.follow(result, needed)

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
            teacher=None if self.teacher is None else self.teacher.labels(),
            privileged=witness.privileged,
            final_privileged=witness.finals(),
        )
        return Chunk(trajectory, episodes)


def following(current: Observation, result: StepResult, needed: NDArray[np.bool_]) -> Observation:
    """What the step led to in the ``needed`` (B,) worlds (F), before any restart.

    ``current`` (B,) is the environment's observation after the step, where a truncated world has
    already begun its next episode. Worlds that terminated have nothing that follows.
    """
    rows = current.take(needed)
    cut = result.truncated & needed
    if cut.any():
        rows.put(cut[needed], result.final_observation.take(cut))
    return rows
