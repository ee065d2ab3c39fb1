"""A copy of anything that simulates has memory of its own and goes on bit for bit the same."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lndrl.config import RunConfig, load_scenario
from lndrl.localization import AMCL
from lndrl.navigation import Navigation, Observation, VectorNavigation, build_surroundings
from lndrl.navigation.environment import NavigationEnv, NavigationVectorEnv
from lndrl.randomness import stream_state
from lndrl.world import World, WorldBatch, beam_bearings

STEPS = 600
SMALL = {
    "scenario": {
        "name": "small",
        "size": [12.0, 8.0],
        "pedestrians": {
            "count": [3, 5],
            "routes": [{"start": [3, 5, 5, 7], "goal": [9, 5, 11, 7]}],
        },
        "robot": [{"start": [1, 1, 2, 2], "goal": [9, 1, 10, 2]}],
    },
    "localization": {"min_particles": 50, "max_particles": 100, "delay": 2},
    "task": {"time_limit": 2.0},
}
RANDOM = {
    "scenario": load_scenario("random").model_dump(),
    "localization": {"min_particles": 50, "max_particles": 100},
    "task": {"time_limit": 2.0},
}
CONFIGS = {
    "small": RunConfig.model_validate(SMALL),
    "perfect": RunConfig.model_validate({**SMALL, "localization": "perfect"}),
    "random": RunConfig.model_validate(RANDOM),
}
COPIES: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
}
copies = pytest.mark.parametrize("copied", COPIES.values(), ids=list(COPIES))


def play(env: NavigationEnv, action: int) -> tuple[Any, ...]:
    """One step with what follows an end, as bytes and plain values that can be compared."""
    observation, reward, terminated, truncated, info = env.step(action)
    if terminated or truncated:
        observation, began = env.reset()
        info = {**info, **began}
    return {k: v.tobytes() for k, v in observation.items()}, reward, terminated, truncated, info


@pytest.mark.parametrize("kind", ["small", "perfect", "random"])
def test_copies_of_an_environment_go_on_as_it_does(kind: str) -> None:
    actions = np.random.default_rng(0).integers(0, 28, STEPS + 7).tolist()
    env, alone = NavigationEnv(CONFIGS[kind]), NavigationEnv(CONFIGS[kind])
    env.reset(seed=5)
    alone.reset(seed=5)
    for action in actions[:7]:
        assert play(env, action) == play(alone, action)
    deep, unpickled = (copied(env) for copied in COPIES.values())
    ends = 0
    for action in actions[7:]:
        step = play(alone, action)
        # One after the other, so that memory which they shared would show.
        assert play(deep, action) == step
        assert play(unpickled, action) == step
        assert play(env, action) == step
        ends += step[2] or step[3]
    assert ends >= 100  # in random layouts: more than two of them


@copies
@pytest.mark.parametrize("kind", ["small", "random"])
def test_copies_of_many_worlds_go_on_as_they_do(kind: str, copied: Callable[[Any], Any]) -> None:
    many = VectorNavigation(CONFIGS[kind], worlds=3)
    rng = np.random.default_rng(1)
    many.step(rng.integers(0, 28, 3))
    other = copied(many)
    shown = (
        other.observation
    )  # held before anything is stepped: rewritten in place as the original's
    for _ in range(40):
        actions = rng.integers(0, 28, 3)
        mine, theirs = many.step(actions), other.step(actions)
        assert mine.reward.tobytes() == theirs.reward.tobytes()
        assert mine.episodes == theirs.episodes
        assert other.observation is shown
        for name, array in vars(many.observation).items():
            assert array.tobytes() == getattr(shown, name).tobytes()
            assert not np.shares_memory(array, getattr(shown, name))


@copies
def test_a_copied_vector_environment_goes_on(copied: Callable[[Any], Any]) -> None:
    many = NavigationVectorEnv(3, CONFIGS["small"])
    many.reset(seed=4)
    other = copied(many)
    for k in range(20):
        a, b = many.step(np.full(3, k)), other.step(np.full(3, k))
        assert a[1].tolist() == b[1].tolist()
        assert all(a[0][name].tobytes() == b[0][name].tobytes() for name in a[0])


@copies
def test_copied_navigation_writes_to_its_own_memory(copied: Callable[[Any], Any]) -> None:
    config = CONFIGS["small"]
    rows = Observation.zeros_for(2, config)
    surroundings = build_surroundings(config)
    world = Navigation(*surroundings, config, 3, rows.take((1, Ellipsis)))
    world.reset(0)
    other = copied(world)
    before = rows.copy()
    other.step(0.6, 0.0)
    assert rows.scan.tobytes() == before.scan.tobytes()
    assert other.observation.scan.tobytes() != before.scan[1].tobytes()
    assert other.batch.tracks.steps[0, 0] == other.steps == 1 and world.steps == 0
    assert np.shares_memory(other.world.pose_true, other.batch.world.robots.pose)
    assert np.shares_memory(other.localization.pose_estimated, other.batch.beliefs.pose)
    assert np.shares_memory(other.scan, other.batch.tracks.scan)


@copies
def test_copied_world_and_its_batch(copied: Callable[[Any], Any]) -> None:
    config = CONFIGS["small"]
    place, _ = build_surroundings(config)
    batch = WorldBatch(place, config.world, 2)
    worlds = [World(place, config.world, batch, i) for i in range(2)]
    for i, world in enumerate(worlds):
        world.reset(7, i, 0)
        world.begin_step(0.4, 0.3)
    others = copied(worlds)
    assert others[0].batch is others[1].batch is not batch
    for _ in range(20):
        for mine, theirs in zip(worlds, others, strict=True):
            assert mine.tick() == theirs.tick()
            assert mine.pose_true.tobytes() == theirs.pose_true.tobytes()
            assert mine.leg_position.tobytes() == theirs.leg_position.tobytes()
            assert mine.scan().tobytes() == theirs.scan().tobytes()
    assert np.shares_memory(others[1].pose_true, others[1].batch.robots.pose)


@copies
def test_copied_filter(copied: Callable[[Any], Any]) -> None:
    config = CONFIGS["small"]
    _, field = build_surroundings(config)
    laser = config.world.laser
    mine = AMCL(field, config.localization, laser)
    mine.reset([1.5, 1.5, 0.0], stream_state(1))
    theirs = copied(mine)
    bearings = beam_bearings(laser)[::12].astype(np.float32)
    for k in range(1, 20):
        odometry = np.array([0.05 * k, 0.0, 0.0])
        ranges = np.full(len(bearings), 3.0, np.float32)
        assert mine.update(odometry, ranges, bearings)
        assert theirs.update(odometry, ranges, bearings)
        assert mine.particles.tobytes() == theirs.particles.tobytes()
        assert theirs.variance.tolist() == np.diagonal(theirs.covariance).tolist()
        assert mine.variance.tolist() == theirs.variance.tolist()


def test_a_deep_copy_shares_what_is_never_written() -> None:
    env = NavigationEnv(CONFIGS["small"])
    other = copy.deepcopy(env)
    assert other.navigation.place is env.navigation.place
    assert other.navigation.batch.world.setting is env.navigation.batch.world.setting
    assert other.navigation.batch.field is env.navigation.batch.field
