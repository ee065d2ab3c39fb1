"""Many worlds at once are the same worlds one by one, with resets in between."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation.navigation import Navigation, build_surroundings
from lndrl.navigation.observation import Observation
from lndrl.navigation.vector import VectorNavigation

CONFIG = RunConfig.model_validate(
    {
        "seed": 9,
        "scenario": {
            "name": "small",
            "size": [12.0, 8.0],
            "pedestrians": {
                "count": [3, 5],
                "routes": [{"start": [3, 5, 5, 7], "goal": [9, 5, 11, 7]}],
            },
            "robot": [{"start": [1, 1, 2, 2], "goal": [9, 1, 10, 2]}],
        },
        "localization": {"min_particles": 50, "max_particles": 100},
        "task": {"time_limit": 2.4},
    }
)
SURROUNDINGS = build_surroundings(CONFIG)
WORLDS = 3


def made(first_world: int = 4, first_episode: int = 2) -> VectorNavigation:
    return VectorNavigation(CONFIG, first_world, WORLDS, first_episode, SURROUNDINGS)


def same(a: Observation, b: Observation) -> bool:
    return all(
        np.array_equal(x, y) for x, y in zip(vars(a).values(), vars(b).values(), strict=True)
    )


def test_equals_single_worlds_with_auto_reset() -> None:
    vector = made()
    singles = [Navigation(*SURROUNDINGS, CONFIG, 4 + i) for i in range(WORLDS)]
    for single in singles:
        single.reset(2)
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(16):
        actions = rng.integers(0, 28, WORLDS)
        result = vector.step(actions)
        records = []
        for i, single in enumerate(singles):
            transition = single.step(*vector.actions[actions[i]])
            assert result.reward[i] == np.float32(transition.reward)
            assert result.terminated[i] == transition.terminated
            assert result.truncated[i] == transition.truncated
            if transition.record:
                records.append(transition.record)
                assert same(result.final_observation.take(i), single.observation)
                single.reset()
                assert not same(result.final_observation.take(i), single.observation)
            assert same(vector.observation.take(i), single.observation)
        assert result.episodes == records
        ended += len(records)
    assert ended >= 6


def test_time_limit_flags_and_following_episodes() -> None:
    vector = made()
    standing = np.full(WORLDS, 3)
    results = [vector.step(standing) for _ in range(12)]
    for step in (5, 11):
        result = results[step]
        quiet = ~result.terminated
        assert result.truncated[quiet].all()
    records = [record for result in results for record in result.episodes]
    for i in range(WORLDS):
        mine = [record.episode for record in records if record.world == 4 + i]
        assert mine == list(range(2, 2 + len(mine))) and len(mine) >= 2
    assert not any((r.terminated & r.truncated).any() for r in results)


def test_results_of_a_step_outlive_the_next() -> None:
    vector = made()
    first = vector.step(np.array([7, 10, 13]))
    kept = first.reward.copy()
    vector.step(np.array([0, 20, 27]))
    np.testing.assert_array_equal(first.reward, kept)


def test_reset_all_starts_over() -> None:
    vector = made()
    start = vector.observation.copy()
    vector.step(np.array([7, 10, 13]))
    assert not same(vector.observation, start)
    vector.reset_all()
    assert same(vector.observation, start)


def test_on_end_sees_the_ended_world() -> None:
    vector = made()
    seen = []
    vector.on_end = lambda world, record: seen.append((world.snapshot(), record))
    for _ in range(6):
        vector.step(np.full(WORLDS, 3))
    assert len(seen) >= WORLDS
    for snapshot, record in seen:
        assert snapshot.outcome == record.outcome and snapshot.episode == record.episode
        assert snapshot.steps == record.steps


def test_velocities_may_be_anything() -> None:
    vector = made()
    vector.step_velocities(np.full((WORLDS, 2), 0.13))
    assert vector.worlds[0].world.command.tolist() == [0.13, 0.13]


@pytest.mark.parametrize("actions", [[0, 0, 28], [-1, 0, 0], [0, 0], [0, 0, 0, 0]])
def test_refuses_wrong_actions(actions: list[int]) -> None:
    with pytest.raises(ValueError, match=r"actions must|expected commands"):
        made().step(np.array(actions))
