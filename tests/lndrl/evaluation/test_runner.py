from __future__ import annotations

import math
import multiprocessing
from pathlib import Path

import numpy as np
import pytest
import torch

from lndrl.config import RunConfig, load_config
from lndrl.errors import UserError
from lndrl.evaluation import (
    BLOCK,
    EpisodeRunner,
    EvaluationResult,
    evaluate,
    settings_for,
)
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.evaluation.tables import describe
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.navigation import EpisodeRecord, Navigation, Observation, action_table
from lndrl.navigation.families import Family, episode_of
from lndrl.planners import PlannerSource, make_planner, planner_source
from lndrl.policy import initial_weights, load_into, policy_metadata, to_bytes
from lndrl.policy.networks import build_policy
from tests.lndrl.machine.blas import blas_threads

EPISODES = BLOCK + 3


@pytest.fixture(scope="module")
def config() -> RunConfig:
    """A small room that two people cross; a network of a few thousand weights."""
    scenario = {
        "name": "room",
        "size": [9, 6],
        "obstacles": [{"box": [4, 4, 5, 6]}],
        "pedestrians": {
            "count": [2, 2],
            "routes": [{"start": [4, 1, 5, 2], "goal": [4, 2.5, 5, 3.5]}],
        },
        "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
    }
    return RunConfig.model_validate(
        {
            "scenario": scenario,
            "task": {"time_limit": 20.0},
            "localization": {"min_particles": 100, "max_particles": 300},
            "network": {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4},
        }
    )


@pytest.fixture(scope="module")
def learned(config: RunConfig) -> PlannerSource:
    return PlannerSource("learned", config, initial_weights(config))


@pytest.fixture(scope="module")
def sampled(config: RunConfig, learned: PlannerSource) -> EvaluationResult:
    return evaluate(learned, config, EPISODES, seed=4)


def starts(config: RunConfig, spec: str, episodes: range) -> list[tuple[float, ...]]:
    seen: dict[int, tuple[float, ...]] = {}

    def watch(world: Navigation) -> None:
        place = (*world.world.start_pose, *world.world.goal, *world.world.pedestrian_position.flat)
        seen.setdefault(episode_of(world.world_id), tuple(float(value) for value in place))

    list(EpisodeRunner(planner_source(spec), config)(episodes, watch))
    return [seen[k] for k in episodes]


def test_result_does_not_depend_on_the_number_of_workers(
    config: RunConfig, learned: PlannerSource, sampled: EvaluationResult
) -> None:
    told: list[EpisodeRecord] = []
    again = evaluate(learned, config, EPISODES, seed=4, workers=2, progress=told.append)
    assert again == sampled
    assert sorted(record.world for record in told) == [r.world for r in sampled.records]
    assert multiprocessing.active_children() == []


def test_records_are_in_episode_order_and_complete(sampled: EvaluationResult) -> None:
    assert [episode_of(r.world) for r in sampled.records] == list(range(EPISODES))
    assert {r.episode for r in sampled.records} == {0}
    assert sampled.actions == "sampled" and sampled.seed == 4 and sampled.scenario == "room"


def test_threads_are_given_back(config: RunConfig, learned: PlannerSource) -> None:
    meanwhile: list[set[int]] = []
    with kept_threads():
        set_threads(2)
        evaluate(learned, config, 1, progress=lambda _: meanwhile.append(blas_threads()))
        assert {torch.get_num_threads()} == blas_threads() == {2}
    assert meanwhile == [{1}], "sums rounded alike need as many threads everywhere"


def test_every_planner_faces_the_same_episodes(config: RunConfig) -> None:
    straight = starts(config, "straight", range(5))
    assert straight == starts(config, "random", range(5))
    assert len(set(straight)) == 5
    # Episode 3 is the same one in other company.
    assert starts(config, "straight", range(3, 4)) == straight[3:4]
    assert starts(config.model_copy(update={"seed": 99}), "straight", range(5)) != straight


def test_a_longer_evaluation_begins_with_the_shorter_one(config: RunConfig) -> None:
    few = evaluate("random", config, 3, seed=1)
    many = evaluate("random", config, BLOCK + 1, seed=1)
    assert many.records[:3] == few.records
    assert evaluate("random", config, 3, seed=2).records != few.records


def test_seed_decides_sampling_and_greedy_does_not_sample(
    config: RunConfig, learned: PlannerSource, sampled: EvaluationResult
) -> None:
    greedy = evaluate(learned, config, 2, seed=4, greedy=True)
    assert greedy.actions == "greedy"
    assert greedy.records != sampled.records[:2]
    assert greedy == evaluate(learned, config, 2, seed=4, greedy=True)


def test_a_temperature_of_1_is_none_and_a_low_one_is_greedy(
    config: RunConfig, learned: PlannerSource, sampled: EvaluationResult
) -> None:
    assert evaluate(learned.at_temperature(1.0), config, EPISODES, seed=4) == sampled
    greedy = evaluate(learned, config, 2, seed=4, greedy=True)
    cold = evaluate(learned.at_temperature(0.01), config, 2, seed=4)
    assert (cold.actions, cold.temperature) == ("sampled", 0.01)
    assert cold.to_dict()["temperature"] == 0.01 and "temperature" not in sampled.to_dict()
    assert EvaluationResult.from_dict(cold.to_dict()) == cold
    assert "(temperature 0.01)" in describe(cold) and "temperature" not in describe(sampled)
    assert cold.records != sampled.records[:2]
    assert greedy.temperature == 1.0


def test_a_temperature_that_is_none_is_refused(learned: PlannerSource) -> None:
    for wrong in (0.0, -1.0, 1000.0, float("nan")):
        with pytest.raises(UserError, match=r"must be from 0\.01 to 100"):
            learned.at_temperature(wrong)
    with pytest.raises(UserError, match="straight: has no policy to sample at temperature"):
        PlannerSource("straight").at_temperature(0.5)


def test_actions_are_drawn_as_the_tempered_logits_say(config: RunConfig) -> None:
    """One observation, many rows: the shares are those of softmax(logits / T)."""
    network = build_policy(config)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        head = [p for p in network.parameters() if p.shape == (28,)][-1]
        head.copy_(torch.linspace(-1.0, 1.0, 28))
        logits = head.double().numpy()
    observation = Observation.zeros_for(4000, config)
    rows = np.arange(4000)
    for temperature in (0.5, 2.0):
        source = PlannerSource("fixed", config, to_bytes(network)).at_temperature(temperature)
        planner = source.build(config)
        planner.reset(3, rows.tolist())
        velocities = planner.act(observation, rows)
        table = action_table(config.task)
        chosen = (velocities[:, None] == table[None]).all(axis=2).argmax(axis=1)
        shares = np.bincount(chosen, minlength=28) / len(rows)
        expected = np.exp(logits / temperature)
        np.testing.assert_allclose(shares, expected / expected.sum(), atol=0.025)


def test_greedy_takes_the_likeliest_action(config: RunConfig) -> None:
    network = build_policy(config)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
        head = [p for p in network.parameters() if p.shape == (28,)][-1]
        head[21] = 5.0  # v 0.6, w -0.9
    planner = PlannerSource("fixed", config, to_bytes(network)).build(config, greedy=True)
    runner = EpisodeRunner(planner_source("random"), config)
    runner.planner = planner
    commands: set[tuple[float, float]] = set()
    list(runner([0], lambda world: commands.add(tuple(world.world.command.tolist()))))
    assert commands == {(0.0, 0.0), (0.6, -0.9)}


def test_straight_outdoes_random_and_perfect_localization_has_no_error(config: RunConfig) -> None:
    straight = evaluate("straight", config, EPISODES)
    assert straight.actions == "rule"
    random = evaluate("random", config, EPISODES)
    assert straight.metrics.arrival.count > random.metrics.arrival.count
    assert straight.metrics.position_error.mean > 0.0  # type: ignore[operator]
    perfect = evaluate("straight", settings_for(PlannerSource("x", config), None, "perfect"), 4)
    assert perfect.localization == "perfect"
    assert perfect.metrics.position_error.mean == pytest.approx(0.0, abs=1e-9)
    assert perfect.metrics.variance_sum.mean == 0.0


def test_weights_file_is_a_planner(config: RunConfig, tmp_path: Path) -> None:
    network = build_policy(config)
    load_into(network, initial_weights(config))
    file = tmp_path / "policy.safetensors"
    file.write_bytes(to_bytes(network, policy_metadata(config, 3, 100)))
    source = planner_source(str(file))
    assert source.config == config
    assert settings_for(source) == config
    planner = make_planner(str(file))
    planner.reset(0, [0])
    navigation = EpisodeRunner(source, config)
    assert planner.name == str(file)
    assert len(list(navigation([0]))) == 1


def test_config_hash_and_provenance_change_with_the_settings(config: RunConfig) -> None:
    first = evaluate("random", config, 1, seed=0)
    changed = config.model_copy(update={"task": config.task.model_copy(update={"time_limit": 2.0})})
    second = evaluate("random", changed, 1, seed=0)
    assert first.config_hash != second.config_hash
    assert second.records[0].time <= 2.0 + 1e-9
    assert math.isfinite(first.records[0].episode_return)


@pytest.mark.parametrize(
    ("episodes", "workers", "sentence"),
    [(0, 0, "0 episodes"), (-1, 0, "1 or more"), (1, -1, "-1 workers")],
)
def test_impossible_requests(config: RunConfig, episodes: int, workers: int, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        evaluate("random", config, episodes, workers=workers)


def test_unknown_planner_and_foreign_weights(config: RunConfig) -> None:
    with pytest.raises(UserError, match=r"strait: no such run folder.*straight"):
        planner_source("strait")
    with pytest.raises(UserError, match="configuration of its own"):
        make_planner("random")
    wider = config.model_copy(
        update={"network": config.network.model_copy(update={"features": 12})}
    )
    foreign = PlannerSource("foreign", config, initial_weights(wider))
    with pytest.raises(UserError, match="another network"):
        evaluate(foreign, config, 1)


def test_a_scenario_without_room_is_refused_from_a_worker_too(config: RunConfig) -> None:
    data = config.model_dump()
    data["scenario"]["robot"][0]["start"] = [4.2, 4.2, 4.8, 5.8]  # inside the box
    blocked = RunConfig.model_validate(data)
    for workers in (0, 1):
        with pytest.raises(UserError):
            evaluate("random", blocked, 1, workers=workers)


def test_worlds_that_are_used_again_play_as_new_ones(config: RunConfig) -> None:
    """In a random scenario every world has a place, and memory, of its own."""
    generated = load_config(
        DEFAULT_CONFIG, ["scenario=random", "task.time_limit=6", "localization.max_particles=600"]
    )
    for each, number in ((config, 6), (generated, 2)):
        runner = EpisodeRunner(planner_source("random"), each)
        fresh = [
            record
            for k in range(number)
            for record in EpisodeRunner(planner_source("random"), each)([k])
        ]
        first, last = range(number - 1), range(number - 1, number)
        next(runner(first))  # nobody wants the rest
        for episodes in (last, first, last, range(number)):
            again = sorted(runner(episodes), key=lambda record: record.world)
            assert again == [fresh[k] for k in episodes]


def test_worlds_side_by_side_go_on_when_one_between_them_has_ended(config: RunConfig) -> None:
    """Episodes of one block end one after the other, in any order."""
    runner = EpisodeRunner(planner_source("random"), config)
    together = list(runner(range(BLOCK)))
    order = [episode_of(record.world) for record in together]
    assert order != sorted(order) and order != sorted(order, reverse=True)
    assert {r.world: r for r in together} == {r.world: r for k in range(BLOCK) for r in runner([k])}


def test_an_episode_that_a_family_has_not_is_refused(config: RunConfig) -> None:
    runner = EpisodeRunner(planner_source("random"), config)
    with pytest.raises(UserError, match="episode -1 is none of validation"):
        list(runner([-1]))


def test_actions_of_a_world_do_not_depend_on_its_company(
    config: RunConfig, learned: PlannerSource
) -> None:
    runner = EpisodeRunner(learned, config)

    def commands(episodes: list[int]) -> list[tuple[float, ...]]:
        seen: list[tuple[float, ...]] = []

        def watch(world: Navigation) -> None:
            if world.world_id == Family.VALIDATION.world(2):
                seen.append(tuple(world.world.command.tolist()))

        list(runner(episodes, watch))
        return seen

    np.testing.assert_array_equal(commands([2])[:20], commands([0, 1, 2])[:20])
