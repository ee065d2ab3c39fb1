"""A shield around a policy: what would touch somebody soon is vetoed, and the next best is taken.

A policy ranks its actions; the shield follows each along its arc for a moment, past people who walk
on as they do, and takes the first in that ranking that touches nobody. Where nothing is vetoed, the
choice is the policy's own, bit for bit. Walls are not people: the policy knows them from the laser,
and what it ranks next may not be traded for a wall that merely comes near. All of it is ours
(docs/planners.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.kernels import expect, kernel
from lndrl.models import Model, NonNegative, Seconds
from lndrl.navigation import Observation, action_table
from lndrl.planners.rollouts import arc_poses


class ShieldConfig(Model):
    """Parameters of the shield (ours); the clearance is from the robot's edge to a person's."""

    horizon: Seconds = Field(1.2, le=10.0, description="s within which nobody may be touched")
    sample_period: Seconds = Field(0.1, ge=0.02, description="s between two looks, at most")
    margin: NonNegative = Field(0.05, description="m of clearance below which somebody is touched")
    person_radius: NonNegative = Field(0.2, description="m of a person; legs reach as far (GROUP)")


@runtime_checkable
class RankingPlanner(Protocol):
    """A planner that ranks the actions of the table; ``PolicyPlanner`` is one."""

    name: str

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""

    def scores(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.floating]:
        """Scores (B, A) whose largest is the action that would be taken; called once a step."""


class ShieldedPlanner:
    """Takes the best action of ``planner`` that touches nobody within ``parameters.horizon``.

    Touched is who comes nearer than the margin and nearer than at this moment, so that whoever
    stands too close may be left, or waited for, but not approached. Where every action is vetoed,
    it is the one that touches latest; standing, if it is among several such, else the planner's
    best of them. Remembers nothing but its counts: ``vetoes`` (rows,) control steps of each episode
    of the last ``reset`` in which the planner's own choice was vetoed.

    Raises UserError where ``config`` has a policy that does not see people.
    """

    def __init__(
        self, planner: RankingPlanner, config: RunConfig, parameters: ShieldConfig | None = None
    ) -> None:
        self.parameters = p = parameters or ShieldConfig()
        check_shield(planner.name, config)
        self.name = f"{planner.name}+shield"
        self.vetoes = np.zeros(0, np.int64)
        self.planner = planner
        self._actions = action_table(config.task)
        self._stand = int(np.argmin(np.abs(self._actions).sum(axis=1)))
        looks = max(1, int(np.ceil(p.horizon / p.sample_period - 1e-9)))
        self._times = p.horizon * np.arange(1, looks + 1) / looks
        poses = arc_poses(self._actions, self._times)
        self._paths = np.ascontiguousarray(poses[..., :2])
        self._reach = config.world.robot_radius + p.person_radius
        expect(first_touches)

    def reset(self, seed: int, worlds: Sequence[int]) -> None:
        """See ``Planner.reset``."""
        self.vetoes = np.zeros(len(worlds), np.int64)
        self.planner.reset(seed, worlds)

    def act(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """See ``Planner.act``."""
        scores = self.planner.scores(observation, rows)
        chosen, vetoed = choose(scores, self.touches(observation), len(self._times), self._stand)
        self.vetoes[rows] += vetoed
        return self._actions[chosen]

    def touches(self, observation: Observation) -> NDArray[np.int64]:
        """At which look each action first touches somebody, (B, A); their number: at none."""
        out = np.empty((len(observation), len(self._actions)), np.int64)
        first_touches(
            self._paths, self._times, observation.pedestrians, observation.pedestrian_count,
            self._reach, self.parameters.margin, out,
        )  # fmt: skip
        return out


def check_shield(name: str, config: RunConfig) -> None:
    """Raise UserError where the policy ``name`` of ``config`` does not see people."""
    if not config.network.pedestrian_map:
        raise UserError(
            f"{name}: its observation has no people, and a shield without them cannot veto; leave "
            "the shield off, or take a policy with network.pedestrian_map"
        )


def choose(
    scores: NDArray[np.floating], touches: NDArray[np.int64], looks: int, stand: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Actions (B,) by ``scores`` and ``touches`` (B, A), and whether the best was vetoed (B,).

    ``looks``: the touch of who touches nobody; ``stand``: the action that stands still.
    """
    rows = np.arange(len(scores))
    own = scores.argmax(axis=1)
    latest = touches.max(axis=1, keepdims=True)
    # With anything free the latest touch is none, so that the free and the least bad are one set.
    allowed = touches == latest
    chosen = np.where(allowed, scores, -np.inf).argmax(axis=1)
    trapped = latest[:, 0] < looks
    chosen[trapped & allowed[:, stand]] = stand
    vetoed = touches[rows, own] < looks
    return np.where(vetoed, chosen, own), vetoed


@kernel()
def first_touches(paths, times, pedestrians, counts, reach, margin, out):
    """Write to ``out`` (B, A) at which of T looks each action first touches somebody, else T.

    ``paths`` (A, T, 2) m in the robot frame at ``times`` (T,) s; ``pedestrians`` (B, M, 4) m and
    m/s, of which the first ``counts`` (B,) are there and walk on as they do. Robot and person
    touch below ``reach`` + ``margin`` m between their centres, unless they were as near at the
    start. A person who is not a number touches nobody.
    """
    rows = min(pedestrians.shape[0], counts.shape[0], out.shape[0])
    actions = min(paths.shape[0], out.shape[1])
    looks = min(paths.shape[1], times.shape[0])
    for row in range(rows):
        for i in range(actions):
            out[row, i] = looks
        for m in range(min(np.int64(counts[row]), pedestrians.shape[1])):
            x, y = np.float64(pedestrians[row, m, 0]), np.float64(pedestrians[row, m, 1])
            vx, vy = np.float64(pedestrians[row, m, 2]), np.float64(pedestrians[row, m, 3])
            bound = min((reach + margin) ** 2, (1.0 - 1e-6) * (x * x + y * y))
            for i in range(actions):
                for k in range(out[row, i]):
                    dx = x + times[k] * vx - paths[i, k, 0]
                    dy = y + times[k] * vy - paths[i, k, 1]
                    if dx * dx + dy * dy < bound:
                        out[row, i] = k
                        break
