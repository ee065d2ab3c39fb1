"""What training pays beyond the compiled parts: reward terms of a user's own, what they see of a
control step, and what the learner makes of a reward.

Terms run in Python beside the compiled parts, once per control step for all worlds of one memory,
and change training alone: evaluation leaves them out (``as_tested``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lndrl.config import PPOConfig, RandomizeConfig, ReplicaConfig, RetryConfig, RunConfig
from lndrl.errors import UserError
from lndrl.extensions import REWARD_TERM, calling, find, make

if TYPE_CHECKING:
    from lndrl.navigation.batch import NavigationBatch

Floats = NDArray[np.float64]
MOST_PAID = 1e6
"""Of one term in one step, weighted; a thousand times what an arrival pays."""


@dataclass(frozen=True)
class Steps:
    """One control step of N worlds, as reward terms see it: read-only, one row per world.

    Map frame, m, rad, s. "Before" is the moment at which the command was given; estimates and
    variances are those that the robot heard. ``outcome`` holds the numbers of
    ``lndrl.navigation.track``: RUNNING, COLLIDED, LOST, ARRIVED, TIMEOUT.
    """

    pose_true_before: Floats  # (N, 3) x, y, yaw
    pose_true: Floats  # (N, 3)
    pose_estimated_before: Floats  # (N, 3)
    pose_estimated: Floats  # (N, 3)
    variance_before: Floats  # (N, 3) of x, y (m^2) and yaw (rad^2)
    variance: Floats  # (N, 3)
    command_before: Floats  # (N, 2) v (m/s), w (rad/s) of the step before, 0 in the first
    command: Floats  # (N, 2) of this step
    goal: Floats  # (N, 2)
    scan: NDArray[np.float32]  # (N, beams) m, from -fov/2 to +fov/2
    pedestrian_position: Floats  # (N, P, 2); rows from pedestrian_count on mean nothing
    pedestrian_velocity: Floats  # (N, P, 2)
    pedestrian_count: NDArray[np.int64]  # (N,)
    steps: NDArray[np.int64]  # (N,) taken in the episode, this one included
    outcome: NDArray[np.int64]  # (N,) RUNNING, or how the episode ended
    parts: Floats  # (N, 6) what the compiled parts pay, in the order of REWARD_PARTS


Term = Callable[[Steps], Floats]
Array = TypeVar("Array", bound=NDArray[Any])


class OwnTerms:
    """The terms of ``config``, what they have paid last and in the running episodes.

    Raises UserError where one is not trusted, not there, or not what it should be.
    """

    def __init__(self, config: RunConfig, worlds: int) -> None:
        chosen = config.task.reward.terms
        self.names = tuple(chosen)
        self._uses = [term.use for term in chosen.values()]
        self._weights = [term.weight for term in chosen.values()]
        self._terms: list[Term] = [
            _make(name, term.use, config, dict(term.settings)) for name, term in chosen.items()
        ]
        self.paid = np.zeros((worlds, len(chosen)))
        self.sums = np.zeros((worlds, len(chosen)))
        self._variance = np.zeros((worlds, 3))
        self._command = np.zeros((worlds, 2))

    def begin(self, world: int) -> None:
        """An episode of ``world`` starts."""
        self.paid[world] = 0.0
        self.sums[world] = 0.0

    def before(self, batch: NavigationBatch, first: int, worlds: int) -> None:
        """Remember what a step of ``worlds`` worlds from ``first`` on overwrites."""
        rows = slice(first, first + worlds)
        self._variance[rows] = batch.tracks.variance[rows]
        self._command[rows] = batch.world.robots.command[rows]

    def pay(self, batch: NavigationBatch, first: int, worlds: int) -> None:
        """Add what the terms pay for the step that has just been judged to its reward."""
        rows = slice(first, first + worlds)
        steps = self._seen(batch, rows)
        for k, (name, use, term) in enumerate(
            zip(self.names, self._uses, self._terms, strict=True)
        ):
            with calling(REWARD_TERM, use):
                answer = np.asarray(term(steps), dtype=np.float64)
            if answer.shape != (worlds,):
                raise UserError(
                    f"reward term {use}: must pay an array ({worlds},), a number per world, "
                    f"not {answer.shape}"
                )
            paid = self._weights[k] * answer
            wrong = np.flatnonzero(~(np.abs(paid) <= MOST_PAID))  # NaN fails every comparison
            if len(wrong):
                raise UserError(
                    f"reward term {use} pays {paid[wrong[0]]:g} as {name} in step "
                    f"{steps.steps[wrong[0]]} of an episode; it must be finite, at most "
                    f"{MOST_PAID:g} either way"
                )
            self.paid[rows, k] = paid
        self.sums[rows] += self.paid[rows]
        batch.tracks.reward[rows, 0] += self.paid[rows].sum(axis=1)

    def _seen(self, batch: NavigationBatch, rows: slice) -> Steps:
        robots, people, tracks = batch.world.robots, batch.world.people, batch.tracks
        return Steps(
            pose_true_before=_read_only(tracks.before[rows, 0]),
            pose_true=_read_only(robots.pose[rows]),
            pose_estimated_before=_read_only(tracks.before[rows, 1]),
            pose_estimated=_read_only(tracks.reports[rows, -1, :3]),
            variance_before=_read_only(self._variance[rows]),
            variance=_read_only(tracks.variance[rows]),
            command_before=_read_only(self._command[rows]),
            command=_read_only(robots.command[rows]),
            goal=_read_only(robots.goal[rows]),
            scan=_read_only(tracks.scan[rows]),
            pedestrian_position=_read_only(people.position[rows, :-1]),
            pedestrian_velocity=_read_only(people.velocity[rows, :-1]),
            pedestrian_count=_read_only(people.count[rows, 0]),
            steps=_read_only(tracks.steps[rows, 0]),
            outcome=_read_only(tracks.outcome[rows, 0]),
            parts=_read_only(tracks.parts[rows]),
        )


def own_terms(config: RunConfig, worlds: int) -> OwnTerms | None:
    """The reward terms of ``config`` for ``worlds`` worlds; None where it has none."""
    return OwnTerms(config, worlds) if config.task.reward.terms else None


def as_tested(config: RunConfig) -> RunConfig:
    """``config`` as it is tested: paid by the compiled parts alone, without a limit, and with the
    same settings in every episode.
    """
    config, reward = as_settled(config), config.task.reward
    if not reward.terms and reward.pose_limit is None:
        return config
    reward = reward.model_copy(update={"terms": {}, "pose_limit": None})
    task = config.task.model_copy(update={"reward": reward})
    return config.model_copy(update={"task": task})


def as_settled(config: RunConfig) -> RunConfig:
    """``config`` with the same settings in every episode, and paid as in training."""
    settled = {
        "randomize": RandomizeConfig(),
        "replicas": ReplicaConfig(),
        "retry": RetryConfig(),
    }
    if all(getattr(config, name) == value for name, value in settled.items()):
        return config
    return config.model_copy(update=settled)


def learning_reward(reward: NDArray[np.float32], ppo: PPOConfig) -> NDArray[np.float32]:
    """Rewards as the learner uses them: scaled, then clipped where a limit is set."""
    scaled = reward * np.float32(ppo.reward_scale)
    return scaled if ppo.reward_limit is None else scaled.clip(-ppo.reward_limit, ppo.reward_limit)


def _make(name: str, use: str, config: RunConfig, settings: dict[str, object]) -> Term:
    found = find(REWARD_TERM, use, where=f"task.reward.terms.{name}")
    assert found is not None  # no term is built in
    term: Term = make(REWARD_TERM, found, use, config, **settings)
    return term


def _read_only(array: Array) -> Array:
    view = array.view()
    view.flags.writeable = False
    return view
