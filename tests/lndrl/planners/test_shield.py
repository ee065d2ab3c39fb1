from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation import Observation, action_table
from lndrl.planners import PlannerSource, PredictivePlanner, ShieldConfig, ShieldedPlanner
from lndrl.planners.policy import PolicyPlanner
from lndrl.planners.rollouts import arc_poses
from lndrl.planners.shield import choose
from lndrl.policy import PolicyRunner, initial_weights
from tests.lndrl.planners.seen import Person, drive, seen, wall_ahead

ROWS = np.arange(1)
PERSON = st.tuples(
    st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)
)
CROWD = st.lists(PERSON, min_size=0, max_size=6)


class Fixed:
    """Ranks actions by scores that are given."""

    name = "fixed"

    def __init__(self, scores: NDArray[np.float64]) -> None:
        self.given = scores

    def reset(self, seed: int, worlds: object) -> None:
        pass

    def scores(self, observation: Observation, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.tile(self.given, (len(observation), 1))


def shield_of(
    config: RunConfig, scores: NDArray[np.float64], parameters: ShieldConfig | None = None
) -> ShieldedPlanner:
    planner = ShieldedPlanner(Fixed(scores), config, parameters)
    planner.reset(0, [0])
    return planner


def ahead_first(config: RunConfig) -> NDArray[np.float64]:
    """Scores of who would drive straight and fast, then straight and slower, then whatever."""
    v, w = action_table(config.task).T
    return v - 10.0 * np.abs(w)


def first_touch(config: RunConfig, people: list[Person], p: ShieldConfig) -> NDArray[np.int64]:
    """What the kernel does, action by action and look by look."""
    looks = max(1, math.ceil(p.horizon / p.sample_period - 1e-9))
    times = p.horizon * np.arange(1, looks + 1) / looks
    near = config.world.robot_radius + p.person_radius + p.margin
    actions = action_table(config.task)
    found = np.full(len(actions), looks)
    crowd = np.asarray(people, np.float32).astype(np.float64).reshape(-1, 4)
    for i, action in enumerate(actions):
        path = arc_poses(action[None], times)[0, :, :2]
        for k in range(looks):
            apart = np.linalg.norm(crowd[:, :2] + times[k] * crowd[:, 2:] - path[k], axis=1)
            now = np.linalg.norm(crowd[:, :2], axis=1)
            if np.any((apart < near) & (apart < now * (1 - 5e-7))):
                found[i] = k
                break
    return found


@settings(max_examples=150, deadline=None)
@given(people=CROWD, margin=st.floats(0.0, 0.4), horizon=st.floats(0.1, 2.5))
def test_the_kernel_is_its_plain_twin(
    config: RunConfig, people: list[Person], margin: float, horizon: float
) -> None:
    p = ShieldConfig(horizon=horizon, margin=margin)
    planner = shield_of(config, ahead_first(config), p)
    kernel = planner.touches(seen((5.0, 0.0), people=people))[0]
    # A rounding apart at the very edge of a touch.
    assert (kernel != first_touch(config, people, p)).sum() <= 1


@settings(max_examples=150, deadline=None)
@given(people=CROWD, seed=st.integers(0, 2**32 - 1))
def test_it_never_takes_what_is_vetoed_while_something_is_free(
    config: RunConfig, people: list[Person], seed: int
) -> None:
    actions = action_table(config.task)
    scores = np.random.default_rng(seed).gumbel(size=len(actions))
    planner = shield_of(config, scores)
    observation = seen((5.0, 0.0), people=people)
    touches, taken = planner.touches(observation)[0], planner.act(observation, ROWS)[0]
    chosen = int(np.flatnonzero((actions == taken).all(axis=1))[0])
    free = touches == 12  # looks of 0.1 s in 1.2 s
    if free.any():
        assert free[chosen] and scores[chosen] == scores[free].max()
    else:
        assert touches[chosen] == touches.max()
    assert planner.vetoes[0] == (not free[scores.argmax()])


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), people=CROWD)
def test_a_choice_that_touches_nobody_is_the_policys_own(
    config: RunConfig, seed: int, people: list[Person]
) -> None:
    scores = np.random.default_rng(seed).gumbel(size=28)
    planner = shield_of(config, scores)
    observation = seen((5.0, 0.0), people=people)
    own = scores.argmax()
    if planner.touches(observation)[0, own] == 12:
        assert np.array_equal(planner.act(observation, ROWS)[0], action_table(config.task)[own])
        assert planner.vetoes[0] == 0


def test_someone_who_stands_ahead_is_not_driven_at(config: RunConfig) -> None:
    planner = shield_of(config, ahead_first(config))
    touches = planner.touches(seen((5.0, 0.0), people=[(0.5, 0.0, 0.0, 0.0)]))[0]
    v, w = action_table(config.task).T
    assert (touches[(v > 0) & (np.abs(w) < 0.5)] < 12).all() and touches[3] == 12
    taken = planner.act(seen((5.0, 0.0), people=[(0.5, 0.0, 0.0, 0.0)]), ROWS)[0]
    assert tuple(taken) == (0.0, 0.0) and planner.vetoes[0] == 1


def test_who_stands_too_near_may_be_left_and_waited_for(config: RunConfig) -> None:
    planner = shield_of(config, ahead_first(config))
    behind = planner.touches(seen((5.0, 0.0), people=[(-0.3, 0.0, 0.0, 0.0)]))[0]
    v, w = action_table(config.task).T
    assert behind[3] == 12 and (behind[w == 0.0] == 12).all()
    ahead = planner.touches(seen((5.0, 0.0), people=[(0.3, 0.0, 0.0, 0.0)]))[0]
    assert ahead[3] == 12 and (ahead[(v > 0.0) & (w == 0.0)] == 0).all()


def test_walls_are_not_people(config: RunConfig) -> None:
    planner = shield_of(config, ahead_first(config))
    assert tuple(planner.act(seen((5.0, 0.0), wall_ahead(0.3)), ROWS)[0]) == (0.6, 0.0)


def test_trapped_it_takes_what_touches_latest_and_stands_if_that_is_among_it() -> None:
    scores = np.array([[3.0, 2.0, 1.0, 0.0]])
    for touches, stand, taken in (
        ([0, 2, 2, 1], 3, 1),
        ([0, 2, 2, 2], 3, 3),
        ([4, 4, 4, 4], 3, 3),
        ([0, 12, 3, 3], 3, 1),
    ):
        chosen, vetoed = choose(scores, np.array([touches]), 12, stand)
        assert chosen[0] == taken and vetoed[0], touches
    chosen, vetoed = choose(scores, np.array([[12, 0, 0, 0]]), 12, 3)
    assert chosen[0] == 0 and not vetoed[0]


def test_driving_straight_on_it_stops_before_who_stands_and_passes_who_walks_away(
    config: RunConfig,
) -> None:
    def stands(time: float) -> list[Person]:
        return [(2.0, 0.0, 0.0, 0.0)]

    poses, _ = drive(shield_of(config, ahead_first(config)), 30, (6.0, 0.0), people=stands)
    assert np.hypot(poses[:, 0] - 2.0, poses[:, 1]).min() > 0.37

    def leaves(time: float) -> list[Person]:
        return [(1.0 + 0.7 * time, 0.0, 0.7, 0.0)]

    planner = shield_of(config, ahead_first(config))
    poses, commands = drive(planner, 10, (6.0, 0.0), people=leaves)
    assert (commands == (0.6, 0.0)).all() and planner.vetoes[0] == 0


@pytest.mark.parametrize("temperature", [1.0, 0.05])
def test_a_policy_behind_it_draws_as_it_would_alone(config: RunConfig, temperature: float) -> None:
    blob = initial_weights(config)

    def policy() -> PolicyPlanner:
        runner = PolicyRunner(config)
        runner.load(blob)
        return PolicyPlanner(runner, temperature=temperature)

    alone, guarded = policy(), ShieldedPlanner(policy(), config)
    rows = np.arange(3)
    for planner in (alone, guarded):
        planner.reset(4, [0, 1, 2])
    observation = Observation.concatenate([seen((5.0, 0.0))] * 3)
    for _ in range(5):
        assert np.array_equal(alone.act(observation, rows), guarded.act(observation, rows))
    # A veto spends no more and no less of an episode's noise.
    beset = observation.copy()
    beset.pedestrian_count[:] = 1
    beset.pedestrians[:, 0] = (0.45, 0.0, -1.0, 0.0)
    alone.act(beset, rows), guarded.act(beset, rows)
    assert np.array_equal(alone.act(observation, rows), guarded.act(observation, rows))
    assert guarded.vetoes.any()


def test_a_policy_that_sees_nobody_is_refused(config: RunConfig) -> None:
    network = config.network.model_copy(update={"pedestrian_map": False})
    blind = config.model_copy(update={"network": network})
    source = PlannerSource("blind", blind, initial_weights(blind), shield=ShieldConfig())
    with pytest.raises(UserError, match="blind: its observation has no people, and a shield"):
        source.build(blind)


def test_a_person_who_is_not_a_number_vetoes_nothing(config: RunConfig) -> None:
    planner = shield_of(config, ahead_first(config))
    odd = [(math.nan, 0.0, 0.0, 0.0), (0.5, math.nan, 0.0, 0.0), (0.5, 0.0, math.nan, 0.0)]
    assert (planner.touches(seen((5.0, 0.0), people=odd)) == 12).all()


def test_only_a_planner_that_ranks_can_be_shielded(config: RunConfig) -> None:
    assert hasattr(PolicyPlanner, "scores") and not hasattr(PredictivePlanner, "scores")
