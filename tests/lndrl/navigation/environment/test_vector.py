"""The compiled vector environment is the same worlds as Gymnasium's own vectorisation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode

from lndrl.config import RunConfig
from lndrl.navigation.environment import NavigationVectorEnv

CONFIG = RunConfig.model_validate(
    {
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
NUMBER = 4


def made(mode: str = "vector_entry_point", **arguments: Any) -> gymnasium.vector.VectorEnv:
    if mode == "sync":
        arguments["vector_kwargs"] = {"autoreset_mode": AutoresetMode.SAME_STEP}
    arguments.setdefault("config", CONFIG)
    return gymnasium.make_vec("lndrl/Navigation-v0", NUMBER, vectorization_mode=mode, **arguments)


def assert_same(a: Any, b: Any, where: str = "") -> None:
    """Nested infos of arrays, equal in values, masks and types of what is there."""
    if isinstance(a, dict):
        assert set(a) == set(b), where
        for key in a:
            assert_same(a[key], b[key], f"{where}.{key}")
    elif isinstance(a, tuple) or (isinstance(a, np.ndarray) and a.dtype == object):
        assert len(a) == len(b), where
        for one, two in zip(a, b, strict=True):
            assert_same(one, two, where)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.tobytes() == b.tobytes(), where
    else:
        assert a == b, where


def test_equals_gymnasiums_own_vectorisation() -> None:
    ours, theirs = made(reward_scale=0.5), made("sync", reward_scale=0.5)
    assert isinstance(ours, NavigationVectorEnv)
    assert ours.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    for space in ("observation_space", "action_space", "single_observation_space"):
        assert getattr(ours, space) == getattr(theirs, space)
    assert ours.single_action_space == theirs.single_action_space
    assert_same(ours.reset(seed=7), theirs.reset(seed=7))
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(20):
        actions = rng.integers(0, 28, NUMBER)
        mine, other = ours.step(actions), theirs.step(actions)
        assert_same(mine, other)
        ends += int((mine[2] | mine[3]).sum())
    assert ends >= 8
    mask = np.array([True, False, True, False])
    again = ours.reset(seed=3, options={"reset_mask": mask, "episode": 2})
    assert_same(again, theirs.reset(seed=3, options={"reset_mask": mask, "episode": 2}))
    seeds: Any = [1, None, 5, 6]
    assert_same(ours.reset(seed=seeds), theirs.reset(seed=seeds))


def test_reward_terms_of_ones_own_are_parts_in_both(own_module: Callable[[str], str]) -> None:
    name = own_module("""
        class Turns:
            def __init__(self, config):
                pass

            def __call__(self, steps):
                return abs(steps.command[:, 1]) / 3.0
    """)
    keys = CONFIG.model_dump(mode="json")
    keys["task"]["reward"]["terms"] = {"turning": {"use": f"{name}:Turns", "weight": -2.0}}
    ours, theirs = made(config=keys), made("sync", config=keys)
    ours.reset(seed=2)
    theirs.reset(seed=2)
    told = 0
    for k in range(8):
        mine, other = ours.step(np.full(NUMBER, k)), theirs.step(np.full(NUMBER, k))
        assert_same(mine, other)
        last = mine[4].get("final_info", {}).get("reward_parts", {})
        told += int(np.count_nonzero(last.get("turning", 0.0)))
    assert told > 0


def test_final_observations_and_infos_are_where_gymnasium_wants_them() -> None:
    ours = made()
    first, _ = ours.reset(seed=1)
    kept = {name: rows.copy() for name, rows in first.items()}
    while True:
        observations, _, terminated, truncated, infos = ours.step(np.full(NUMBER, 3))
        ended = terminated | truncated
        if ended.any():
            break
        assert "final_obs" not in infos
    for name, rows in kept.items():  # what reset gave is still what it was
        assert rows.tobytes() == first[name].tobytes()
    assert infos["_final_obs"].tolist() == infos["_final_info"].tolist() == ended.tolist()
    for i in range(NUMBER):
        assert (infos["final_obs"][i] is not None) == ended[i]
        if ended[i]:
            assert ours.single_observation_space.contains(infos["final_obs"][i])
            assert infos["final_info"]["outcome"][i] in ("timeout", "collided", "lost", "arrived")
            assert (infos["final_obs"][i]["scan"] != observations["scan"][i]).any()
            assert infos["episode_number"][i] == 1
    assert ours.observation_space.contains(observations)


def test_statistics_of_gymnasium_read_it() -> None:
    ours = gymnasium.wrappers.vector.RecordEpisodeStatistics(made())
    ours.reset(seed=1)
    for _ in range(14):
        ours.step(np.full(NUMBER, 3))
    assert len(ours.length_queue) >= NUMBER and max(ours.length_queue) <= 6


def test_without_a_seed_worlds_differ_and_np_random_decides() -> None:
    first, second = made(), made()
    a, b = first.reset()[0]["goal"], second.reset()[0]["goal"]
    assert len({row.tobytes() for row in (*a, *b)}) == 2 * NUMBER
    for each in (first, second):
        each.np_random = np.random.default_rng(5)
    assert first.reset()[0]["goal"].tobytes() == second.reset()[0]["goal"].tobytes()


def test_pictures() -> None:
    ours = made(render_mode="rgb_array")
    with pytest.raises(ResetNeeded):
        ours.render()
    ours.reset(seed=1)
    pictures: Any = ours.render()
    assert len(pictures) == NUMBER
    assert pictures[0].shape == (160, 240, 3)
    silent = made()
    silent.reset()
    assert silent.render() is None


def test_wrong_use_is_refused() -> None:
    ours = made()
    with pytest.raises(ResetNeeded, match="reset"):
        ours.step(np.zeros(NUMBER, np.int64))
    ours.reset(seed=1)
    wrong_actions: list[Any] = [
        np.zeros(3, np.int64),
        np.zeros(NUMBER),
        np.zeros(NUMBER, np.bool_),
        28,
        [28] * 4,
    ]
    wrong_seeds: list[Any] = [1.5, True, [1, 2], [1, 2, 3, True]]
    wrong_options: list[Any] = [{"mask": 1}, {"episode": 1.5}, {"reset_mask": [True] * 4}, 3]
    for actions in wrong_actions:
        with pytest.raises(ValueError, match="actions must be"):
            ours.step(actions)
    for seed in wrong_seeds:
        with pytest.raises(ValueError, match="seed"):
            ours.reset(seed=seed)
    for options in wrong_options:
        with pytest.raises(ValueError, match="option"):
            ours.reset(options=options)
    with pytest.raises(ValueError, match="num_envs"):
        NavigationVectorEnv(0, CONFIG)
    with pytest.raises(ValueError, match="rgb_array"):
        NavigationVectorEnv(1, CONFIG, render_mode="human")
    ours.close()
    ours.close()
    for use in (lambda: ours.step(np.zeros(NUMBER, np.int64)), ours.reset, ours.render):
        with pytest.raises(ClosedEnvironmentError, match="closed"):
            use()


def test_its_spec_goes_through_json() -> None:
    ours = made()
    assert ours.spec is not None
    spec = gymnasium.envs.registration.EnvSpec.from_json(ours.spec.to_json())
    again = gymnasium.make_vec(spec)
    assert isinstance(again, NavigationVectorEnv)
    assert again.config == CONFIG and again.num_envs == NUMBER
