"""The Gymnasium face of the task."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils.env_checker import check_env
from PIL import Image

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation.environment import NavigationEnv
from lndrl.navigation.episode import EpisodeRecord
from lndrl.navigation.reward import REWARD_PARTS

SCENARIO = {
    "name": "small",
    "size": [12.0, 8.0],
    "pedestrians": {
        "count": [3, 5],
        "routes": [{"start": [3, 5, 5, 7], "goal": [9, 5, 11, 7]}],
    },
    "robot": [{"start": [1, 1, 2, 2], "goal": [9, 1, 10, 2]}],
}
CONFIG = RunConfig.model_validate(
    {
        "scenario": SCENARIO,
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
    assert info == {"episode_number": 0}
    terminated = truncated = False
    steps = 0
    while not (terminated or truncated):
        assert made.observation_space.contains(observation)
        observation, reward, terminated, truncated, info = made.step(3)
        assert reward == pytest.approx(sum(info["reward_parts"].values()))
        steps += 1
    assert made.observation_space.contains(observation)
    record = EpisodeRecord.from_dict(info["episode_record"])
    assert record.steps == steps <= 5
    assert made.reset()[1] == {"episode_number": 1}
    assert made.reset(options={"episode": 7})[1] == {"episode_number": 7}
    assert made.reset(seed=3)[1] == {"episode_number": 0}


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


def goal(made: NavigationEnv, **arguments: Any) -> list[float]:
    observation, _ = made.reset(**arguments)
    return observation["goal"].tolist()


def test_without_a_seed_the_stream_is_drawn_from_np_random() -> None:
    first, second = NavigationEnv(CONFIG), NavigationEnv(CONFIG)
    assert goal(first) != goal(second)
    one = first.navigation.seed
    assert goal(first) and first.navigation.seed == one  # goes on in its stream
    assert first.navigation.episode == 1
    for made in (first, second):
        made.np_random = np.random.default_rng(3)
    assert goal(first) == goal(second)
    assert first.navigation.seed == second.navigation.seed != one
    assert first.navigation.episode == 0
    fresh = NavigationEnv(CONFIG)
    seed = first.navigation.seed
    assert goal(fresh, seed=seed, options={"episode": 4}) == goal(first, options={"episode": 4})


def test_seeds_of_a_random_scenario_play_different_layouts() -> None:
    made = NavigationEnv(scenario="random")
    made.reset(seed=1)
    place = made.navigation.place
    made.reset(seed=2)
    assert made.navigation.place.cells.tobytes() != place.cells.tobytes()


def test_what_info_says() -> None:
    made = NavigationEnv(CONFIG)
    outcomes = set()
    for episode in range(12):
        made.reset(seed=1, options={"episode": episode})
        over = False
        while not over:
            _, reward, terminated, truncated, info = made.step(24)
            over = terminated or truncated
            assert list(info["reward_parts"]) == list(REWARD_PARTS)
            assert reward == pytest.approx(sum(info["reward_parts"].values()))
            assert ("is_success" in info) == ("outcome" in info) == over
        assert info["outcome"] == info["episode_record"]["outcome"]
        assert info["is_success"] is (info["outcome"] == "arrived")
        assert truncated == (info["outcome"] == "timeout")
        outcomes.add(info["outcome"])
    assert len(outcomes) > 1


def test_reward_scale() -> None:
    plain, scaled = NavigationEnv(CONFIG), NavigationEnv(CONFIG, reward_scale=0.01)
    plain.reset(seed=1)
    scaled.reset(seed=1)
    for _ in range(5):
        _, reward, *_, info = plain.step(24)
        _, small, *_, little = scaled.step(24)
        assert small == 0.01 * reward
        for name, part in info["reward_parts"].items():
            assert little["reward_parts"][name] == 0.01 * part
    assert little["episode_record"] == info["episode_record"]
    for wrong in (0, -1.0, True, np.nan, np.inf, "1"):
        with pytest.raises(ValueError, match="reward_scale must be a finite number above 0"):
            NavigationEnv(CONFIG, reward_scale=wrong)  # type: ignore[arg-type]


def test_a_scenario_takes_the_place_of_the_configurations() -> None:
    made = NavigationEnv(CONFIG, scenario="corridor")
    assert made.config.scenario.name == "corridor"
    assert made.config.task == CONFIG.task
    keys = {"scenario": "hall", "localization": "perfect"}
    assert NavigationEnv(keys).config.scenario.name == "hall"
    assert NavigationEnv(keys, scenario="hybrid").config.scenario.name == "hybrid"
    assert NavigationEnv({}).config == RunConfig.model_validate(NavigationEnv().config)
    assert keys == {"scenario": "hall", "localization": "perfect"}
    with pytest.raises(UserError, match=r"config: unknown key taks; did you mean task\?"):
        NavigationEnv({"taks": 1})
    with pytest.raises(ValueError, match="config must be a RunConfig"):
        NavigationEnv(3)  # type: ignore[arg-type]
    for wrong in (3, ""):
        with pytest.raises(ValueError, match="scenario must be a name"):
            NavigationEnv(CONFIG, scenario=wrong)  # type: ignore[arg-type]
    nothings: list[Any] = ["", [], False]
    for nothing in nothings:
        with pytest.raises(UserError, match="scenario"):
            NavigationEnv({"scenario": nothing})


def test_a_scenario_may_be_a_path(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(json.dumps(SCENARIO | {"name": "own"}))
    assert NavigationEnv(CONFIG, scenario=file).config.scenario.name == "own"
    assert NavigationEnv({"scenario": file}).config.scenario.name == "own"


def test_what_a_map_made_of_the_scenario_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    floor = np.full((160, 200), 205, np.uint8)
    Image.fromarray(floor).save(tmp_path / "grey.pgm")
    (tmp_path / "grey.yaml").write_text(
        "image: grey.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    made = NavigationEnv(scenario=tmp_path / "grey.yaml")
    assert "grey.yaml: free_thresh 0.25 makes floor of grey 205" in caplog.text
    caplog.clear()
    other = NavigationEnv(made.config)
    assert other.navigation.place is made.navigation.place and not caplog.text


@pytest.mark.parametrize("wrong", [1.5, True, -1, "1", np.bool_(True)])
def test_numbers_that_are_none_are_refused(wrong: Any) -> None:
    made = NavigationEnv(CONFIG)
    with pytest.raises(ValueError, match="seed must be a whole number from 0"):
        made.reset(seed=wrong)
    with pytest.raises(ValueError, match=r"options\['episode'\] must be a whole number"):
        made.reset(options={"episode": wrong})
    with pytest.raises(ValueError, match="world_id must be a whole number"):
        NavigationEnv(CONFIG, world_id=wrong)
    made.reset(seed=np.int64(3), options={"episode": np.uint8(2)})  # type: ignore[arg-type]
    assert made.navigation.seed == 3 and made.navigation.episode == 2
    with pytest.raises(ValueError, match="action must be"):
        made.step(wrong)


def test_options_that_are_none_are_refused() -> None:
    made = NavigationEnv(CONFIG)
    with pytest.raises(ValueError, match="option 'epsiode' is unknown; known: episode"):
        made.reset(options={"epsiode": 2})
    with pytest.raises(ValueError, match="options must be a dict"):
        made.reset(options=[2])  # type: ignore[arg-type]
    made.reset(options={})


def test_nothing_runs_before_reset_after_an_end_and_after_close() -> None:
    made = NavigationEnv(CONFIG, render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match="reset"):
        made.step(3)
    with pytest.raises(ResetNeeded, match="reset"):
        made.render()
    made.reset(seed=0)
    while not any(made.step(3)[2:4]):
        pass
    with pytest.raises(ResetNeeded, match="reset"):
        made.step(3)
    made.reset()
    made.close()
    made.close()
    for use in (lambda: made.step(3), made.reset, made.render):
        with pytest.raises(ClosedEnvironmentError, match="closed"):
            use()


def test_a_spec_with_a_configuration_goes_through_json(tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text(CONFIG.to_yaml())
    keys = CONFIG.model_dump(mode="json")
    for config in (CONFIG, file, str(file), keys):
        made = gymnasium.make("lndrl/Navigation-v0", config=config, reward_scale=0.5)
        assert made.spec is not None
        text = made.spec.to_json()
        assert json.loads(text)["id"] == "lndrl/Navigation-v0"
        again = gymnasium.make(EnvSpec.from_json(text)).unwrapped
        assert isinstance(again, NavigationEnv)
        assert again.config == CONFIG and again.reward_scale == 0.5


def test_a_spec_with_numpy_numbers_goes_through_json(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(json.dumps(SCENARIO))
    keys = {
        "scenario": file,
        "seed": np.int64(4),
        "task": {"time_limit": np.float32(2.0), "reward": CONFIG.task.reward},
    }
    for many in (False, True):
        make: Any = gymnasium.make_vec if many else gymnasium.make
        made = make(
            "lndrl/Navigation-v0",
            config=keys,
            scenario=file,
            reward_scale=np.float32(0.5),
            world_id=np.int64(3),
        )
        again = make(EnvSpec.from_json(made.spec.to_json())).unwrapped
        assert again.config == made.unwrapped.config and again.config.seed == 4
        assert again.reward_scale == 0.5


def test_environments_share_what_is_never_written() -> None:
    first, second = NavigationEnv(CONFIG), NavigationEnv(CONFIG.model_copy(update={"seed": 9}))
    assert first.navigation.place is second.navigation.place
    assert first.navigation.batch.field is second.navigation.batch.field
    other = NavigationEnv(CONFIG, scenario="corridor")
    assert other.navigation.place is not first.navigation.place
