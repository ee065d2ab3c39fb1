"""Reward terms of one's own: what they see, how they are paid, and where they are not."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lndrl.config import PPOConfig, RunConfig
from lndrl.errors import UserError
from lndrl.evaluation import EpisodeRunner
from lndrl.models import effective
from lndrl.navigation import REWARD_PARTS, EpisodeRecord, Navigation, VectorNavigation
from lndrl.navigation.navigation import build_surroundings
from lndrl.navigation.terms import Steps, learning_reward
from lndrl.navigation.track import RUNNING
from lndrl.planners import PlannerSource

Write = Callable[..., str]
SCENARIO = {
    "name": "small",
    "size": [9.0, 6.0],
    "pedestrians": {
        "count": [2, 2],
        "routes": [{"start": [4, 1, 5, 2], "goal": [4, 4, 5, 5]}],
    },
    "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
}
SPY = """
    import numpy as np

    SEEN = []

    class Turns:
        def __init__(self, config, most=10.0):
            self.most = most

        def __call__(self, steps):
            SEEN.append({k: np.array(v) for k, v in vars(steps).items()})
            SEEN[-1]["alive"] = steps
            return np.minimum(np.abs(steps.command[:, 1]), self.most)
"""


def made_config(terms: dict[str, Any] | None = None, **more: Any) -> RunConfig:
    return RunConfig.model_validate(
        {
            "scenario": SCENARIO,
            "seed": 5,
            "localization": {"min_particles": 60, "max_particles": 100},
            "task": {"time_limit": 4.0, "reward": {"terms": terms or {}}},
            **more,
        }
    )


def test_a_term_is_a_part_like_the_others(own_module: Write) -> None:
    name = own_module(SPY)
    config = made_config({"turning": {"use": f"{name}:Turns", "weight": -2.0}})
    paid, plain = (VectorNavigation(c, 0, 3) for c in (config, made_config()))
    velocities = np.array([[0.2, 0.9], [0.2, -0.3], [0.0, 0.0]])
    first, second = paid.step_velocities(velocities), plain.step_velocities(velocities)
    expected = -2.0 * np.abs(velocities[:, 1])
    np.testing.assert_allclose(first.reward, second.reward + expected, rtol=1e-6)
    assert paid.worlds[0].part_names == (*REWARD_PARTS, "turning")
    assert paid.worlds[1].transition().parts[-1] == pytest.approx(-0.6)
    records: list[EpisodeRecord] = []
    while not records:
        records = paid.step_velocities(velocities).episodes
    record = next(r for r in records if r.world == 0)
    assert record.reward_parts["turning"] == pytest.approx(-1.8 * record.steps)
    assert record.episode_return == pytest.approx(sum(record.reward_parts.values()))


def test_a_limit_of_the_pose_part_is_for_training_alone() -> None:
    """0.04 limits an error to 0.1 mm: a filter is always farther off than that."""
    reward = {"reward": {"pose_limit": 0.04}, "time_limit": 4.0}
    limited = made_config(task=reward)
    paid, plain = (VectorNavigation(c, 0, 3) for c in (limited, made_config()))
    velocities = np.array([[0.2, 0.9], [0.2, -0.3], [0.6, 0.3]])
    first, second = paid.step_velocities(velocities), plain.step_velocities(velocities)
    assert not np.array_equal(first.reward, second.reward)
    for world, unlimited in zip(paid.worlds, plain.worlds, strict=True):
        pose = REWARD_PARTS.index("pose")
        assert abs(world.parts()[pose]) <= 0.04 + 1e-12 < abs(unlimited.parts()[pose])
        np.testing.assert_array_equal(
            np.delete(world.parts(), pose), np.delete(unlimited.parts(), pose)
        )
    source = PlannerSource("straight")
    tested, published = (
        list(EpisodeRunner(source, config)(range(2))) for config in (limited, made_config())
    )
    assert tested == published


def test_the_worlds_themselves_do_not_change(own_module: Write) -> None:
    config = made_config({"turning": {"use": f"{own_module(SPY)}:Turns"}})
    paid, plain = (VectorNavigation(c, 0, 2) for c in (config, made_config()))
    for _ in range(14):  # beyond the end of an episode
        for environment in (paid, plain):
            environment.step(np.array([20, 4]))
        assert np.array_equal(paid.observation.scan, plain.observation.scan)
        assert np.array_equal(paid.observation.goal, plain.observation.goal)


def test_what_a_term_sees(own_module: Write) -> None:
    name = own_module(SPY)
    config = made_config({"turning": {"use": f"{name}:Turns", "settings": {"most": 0.1}}})
    world = Navigation(*build_surroundings(config), config, 7)
    world.reset()
    before, variance = world.world.pose_true.copy(), world.track.variance.copy()
    heard = world.pose_heard.copy()
    world.step(0.4, 0.3)
    world.step(0.6, -0.9)
    one, two = __import__(name).SEEN
    assert np.array_equal(one["pose_true_before"], [before])
    assert np.array_equal(one["pose_estimated_before"], [heard])
    assert np.array_equal(one["variance_before"], [variance])
    assert np.array_equal(one["command_before"], [[0.0, 0.0]])
    assert np.array_equal(one["command"], [[0.4, 0.3]])
    assert np.array_equal(two["command_before"], [[0.4, 0.3]])
    for now, then in (("pose_true", "pose_true_before"), ("variance", "variance_before"),
                      ("pose_estimated", "pose_estimated_before")):  # fmt: skip
        assert np.array_equal(two[then], one[now])
    assert np.array_equal(two["pose_true"], [world.world.pose_true])
    assert np.array_equal(two["goal"], [world.world.goal])
    assert two["scan"].shape == (1, 720) and np.array_equal(two["scan"][0], world.scan)
    people = two["pedestrian_position"][0, : two["pedestrian_count"][0]]
    assert np.array_equal(people, world.world.pedestrian_position)
    assert (one["steps"][0], two["steps"][0], one["outcome"][0]) == (1, 2, RUNNING)
    assert two["parts"].shape == (1, 6)
    assert world.transition().parts[-1] == pytest.approx(0.1)
    alive: Steps = two["alive"]
    for array in vars(alive).values():
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_an_episode_begins_with_nothing_paid(own_module: Write) -> None:
    name = own_module(SPY)
    config = made_config({"turning": {"use": f"{name}:Turns"}})
    world = Navigation(*build_surroundings(config), config, 7)
    returns = []
    for _ in range(2):
        world.reset(3)
        while not world.outcome:
            transition = world.step(0.0, 0.9)
        returns.append(transition.record)
    assert returns[0] == returns[1]
    seen = __import__(name).SEEN
    assert [s["command_before"][0, 1] for s in seen if s["steps"][0] == 1] == [0.0, 0.0]
    world.reset(3)
    assert world.transition().parts[-1] == 0.0


def test_evaluation_neither_pays_nor_imports_a_term(own_module: Write) -> None:
    name = own_module("raise RuntimeError\n", trusted=False)
    config = made_config({"bonus": {"use": f"{name}:Bonus", "weight": 1e5}})
    with pytest.raises(UserError, match="is refused"):
        VectorNavigation(config, 0, 1)
    found = [
        list(EpisodeRunner(PlannerSource("straight"), c)([0, 1])) for c in (config, made_config())
    ]
    assert found[0] == found[1]
    assert set(found[0][0].reward_parts) == set(REWARD_PARTS)


@pytest.mark.parametrize(
    ("pays", "sentence"),
    [
        ("np.full(2, np.nan)", r"pays nan as bonus in step 1 of an episode; it must be finite"),
        ("np.array([0.0, np.inf])", "pays inf as bonus"),
        ("np.full(2, 1e7)", r"pays 1e\+07 as bonus"),
        ("1.0", r"must pay an array \(2,\), a number per world, not \(\)"),
        ("np.zeros(3)", r"not \(3,\)"),
        ("['a', 'b']", "failed: ValueError: could not convert"),
        ("steps.speed", "failed: AttributeError: 'Steps' object has no attribute 'speed'"),
    ],
)
def test_a_wrong_payment_is_one_sentence(own_module: Write, pays: str, sentence: str) -> None:
    name = own_module(f"""
        import numpy as np

        class Bonus:
            def __init__(self, config): pass
            def __call__(self, steps): return {pays}
    """)
    environment = VectorNavigation(made_config({"bonus": {"use": f"{name}:Bonus"}}), 0, 2)
    with pytest.raises(UserError, match=f"reward term {name}:Bonus.*{sentence}"):
        environment.step(np.array([0, 0]))


@pytest.mark.parametrize(
    ("terms", "sentence"),
    [
        ({"step": {"use": "a:B"}}, "step is a part of the reward already"),
        ({"Bad name": {"use": "a:B"}}, "must be a name of small letters"),
        ({"one": {"use": "a b"}}, "'a b' names no part; write module:Class"),
        ({"one": {"use": "a:b.c"}}, "names no part"),
        ({"one": {"use": "a:B", "wieght": 1}}, "wieght"),
        ({"one": {"weight": 1}}, "use"),
        ({"one": {"use": "a:B", "weight": float("nan")}}, "finite"),
        ({f"t{i}": {"use": "a:B"} for i in range(17)}, "at most 16"),
    ],
)
def test_a_wrong_configuration_is_refused(terms: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        made_config(terms)


def test_no_terms_leave_every_hash_as_it_was() -> None:
    assert "terms" not in effective(made_config().task.reward)
    assert "terms" in effective(made_config({"a": {"use": "a:B"}}).task.reward)


def test_records_travel_with_the_run_s_own_parts() -> None:
    parts = {**dict.fromkeys(REWARD_PARTS, 0.0), "turning": 1.0}
    record = EpisodeRecord(0, 0, "lost", 1, 0.4, 0.1, 0.1, 0.1, 0.1, 1.0, parts)
    assert EpisodeRecord.from_dict(record.to_dict(), ("turning",)) == record
    for terms in ((), ("other",), ("turning", "other")):
        with pytest.raises(ValueError, match="reward_parts needs the keys"):
            EpisodeRecord.from_dict(record.to_dict(), terms)
    broken = copy.deepcopy(record.to_dict())
    broken["reward_parts"]["turning"] = float("nan")
    with pytest.raises(ValueError, match="must be finite"):
        EpisodeRecord.from_dict(broken, ("turning",))


def test_rewards_are_scaled_then_clipped() -> None:
    ppo = PPOConfig.model_validate({"reward_scale": 0.01, "reward_limit": 5.0})
    reward = np.array([100.0, -9000.0, 700.0], np.float32)
    np.testing.assert_allclose(learning_reward(reward, ppo), [1.0, -5.0, 5.0])
    plain = ppo.model_copy(update={"reward_limit": None})
    np.testing.assert_allclose(learning_reward(reward, plain), [1.0, -90.0, 7.0])
