"""The Gymnasium face of the task."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import lndrl.navigation  # noqa: F401  (registers the environment)
from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation.environment import NavigationEnv
from lndrl.navigation.episode import EpisodeRecord

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
        "task": {"time_limit": 2.0},
    }
)


def test_gymnasium_checker() -> None:
    made = gymnasium.make("lndrl/Navigation-v0", config=CONFIG, render_mode="rgb_array")
    check_env(made.unwrapped, skip_render_check=False)
    made.close()


def test_observations_stay_in_their_space_until_the_end() -> None:
    made = NavigationEnv(CONFIG)
    observation, info = made.reset(seed=3)
    assert info == {"episode": 0}
    terminated = truncated = False
    steps = 0
    while not (terminated or truncated):
        assert made.observation_space.contains(observation)
        observation, reward, terminated, truncated, info = made.step(3)
        assert reward == pytest.approx(info["reward_parts"].sum())
        steps += 1
    assert made.observation_space.contains(observation)
    record = EpisodeRecord.from_dict(info["episode_record"])
    assert record.steps == steps <= 5
    assert made.reset()[1] == {"episode": 1}
    assert made.reset(options={"episode": 7})[1] == {"episode": 7}
    assert made.reset(seed=3)[1] == {"episode": 0}


def test_seed_chooses_the_stream() -> None:
    made = NavigationEnv(CONFIG)
    first = made.reset(seed=1)[0]["goal"]
    other = made.reset(seed=2)[0]["goal"]
    again = made.reset(seed=1)[0]["goal"]
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_scan_and_map_are_what_the_policy_sees() -> None:
    made = NavigationEnv(CONFIG)
    observation, _ = made.reset(seed=4)
    counts = made.navigation.observation.scan
    np.testing.assert_allclose(observation["scan"][0] * 65535, counts, atol=0.01)
    people = int(made.navigation.observation.pedestrian_count)
    assert observation["pedestrians"][0].any() == (people > 0)


def test_render_only_when_asked_for() -> None:
    made = NavigationEnv(CONFIG, render_mode="rgb_array")
    made.reset(seed=0)
    image = made.render()
    assert image is not None and image.dtype == np.uint8 and image.shape == (160, 240, 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 5
    silent = NavigationEnv(CONFIG)
    silent.reset(seed=0)
    assert silent.render() is None
    with pytest.raises(ValueError, match="rgb_array"):
        NavigationEnv(CONFIG, render_mode="human")


def test_configuration_by_file_or_scenario(tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text(CONFIG.to_yaml())
    assert NavigationEnv(file).config == CONFIG
    assert NavigationEnv(scenario="hybrid").config.scenario.name == "hybrid"
    with pytest.raises(UserError, match="nowhere"):
        NavigationEnv(scenario="nowhere")
    with pytest.raises(UserError, match="no such file"):
        NavigationEnv(tmp_path / "missing.yaml")


def test_refuses_actions_outside_the_table() -> None:
    made = NavigationEnv(CONFIG)
    made.reset(seed=0)
    with pytest.raises(ValueError, match="action must be"):
        made.step(28)
