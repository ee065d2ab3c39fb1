"""The collected chunk, held against a replay of the same worlds and the same policy."""

from __future__ import annotations

import numpy as np
import pytest

from actors.laps import Laps
from actors.rollout import Rollout, following
from lndrl.navigation import Observation, StepResult, Trajectory, VectorNavigation
from lndrl.navigation.families import first_world_of_actor
from lndrl.policy import initial_weights
from lndrl.randomness import Stream


def assert_same(a: Observation, b: Observation) -> None:
    for name in ("scan", "pedestrians", "pedestrian_count", "goal"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def collected(config, number=0, chunks=1, index=0, **options):
    rollout = Rollout(config, index, **options)
    rollout.load(7, initial_weights(config))
    for i in range(chunks):
        chunk = rollout.collect(number + i)
    return rollout, chunk


@pytest.mark.parametrize("time_limit", [1.2, 60.0])
def test_chunk_matches_a_replay_of_its_actions(small_config, time_limit):
    """Observations, rewards, flags, final rows and records, step by step."""
    config = small_config(task={"time_limit": time_limit}, seed=5)
    _, chunk = collected(config, index=2, first_episode=4)
    got = chunk.trajectory
    replay = VectorNavigation(config, first_world_of_actor(2), 2, first_episode=4)
    finals, expected_index, records = [], [], []
    for t in range(8):
        assert_same(got.observation.take(t), replay.observation)
        result = replay.step(got.action[t])
        records += result.episodes
        np.testing.assert_array_equal(got.reward[t], result.reward)
        np.testing.assert_array_equal(got.terminated[t], result.terminated)
        np.testing.assert_array_equal(got.truncated[t], result.truncated)
        for b in range(2):
            if result.truncated[b]:
                finals.append(result.final_observation.take(b).copy())
            elif t == 7 and not result.terminated[b]:
                finals.append(replay.observation.take(b).copy())
            else:
                continue
            expected_index.append(t * 2 + b)
    assert got.final_index.tolist() == expected_index
    assert len(expected_index) == len(got.final_observation)
    for i, final in enumerate(finals):
        assert_same(got.final_observation.take(i), final)
    assert [e.to_dict() for e in chunk.episodes] == [e.to_dict() for e in records]
    if time_limit == 1.2:
        assert got.truncated[:-1].any(), "the case must have an episode cut off in mid-chunk"
    else:
        assert len(expected_index) == 2, "the case must have worlds that go on"


def test_log_probabilities_are_those_of_the_policy(small_config):
    config = small_config()
    rollout, chunk = collected(config)
    got = chunk.trajectory
    for t in range(8):
        table = rollout.runner.log_probabilities(got.observation.take(t))
        expected = table[np.arange(2), got.action[t]]
        np.testing.assert_allclose(got.log_prob[t], expected, rtol=0, atol=1e-5)
    assert (got.version == 7).all()
    assert len(np.unique(got.action)) > 2, "actions are sampled"


def test_chunk_survives_the_wire_and_later_chunks(small_config):
    """What the learner reads is what was collected, though the rollout has gone on since."""
    config = small_config(task={"time_limit": 2.0})
    rollout, chunk = collected(config)
    arrays = chunk.trajectory.to_arrays()
    before = {name: array.copy() for name, array in arrays.items()}
    rollout.collect(1)
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)
    read = Trajectory.from_arrays(arrays, config)
    assert_same(read.observation, chunk.trajectory.observation)
    assert_same(read.final_observation, chunk.trajectory.final_observation)


def test_chunks_continue_the_same_worlds(small_config):
    config = small_config()
    rollout, first = collected(config)
    if not first.trajectory.terminated[-1].any():
        following = rollout.collect(1).trajectory.observation.take(0)
        assert_same(first.trajectory.final_observation, following)
    else:
        pytest.fail("choose a seed whose worlds go on at the chunk's end")


def test_same_seed_same_chunk(small_config):
    first, second = (collected(small_config(), chunks=2)[1].trajectory for _ in range(2))
    a, b = first.to_arrays(), second.to_arrays()
    for name in a:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)


def test_action_noise_depends_on_seed_actor_and_chunk(small_config):
    rollout = Rollout(small_config(), actor_index=4)
    sequence = np.random.SeedSequence(3, spawn_key=(4, 9, Stream.POLICY))
    expected = np.random.default_rng(sequence).random(4)
    np.testing.assert_array_equal(rollout.action_generator(9).random(4), expected)
    assert rollout.action_generator(8).random() != expected[0]


def test_worlds_of_actors_are_distinct(small_config):
    ids = []
    for index in (0, 1):
        _, chunk = collected(small_config(task={"time_limit": 0.8}), index=index, worlds=3)
        assert chunk.trajectory.action.shape == (8, 3)
        ids += sorted({episode.world for episode in chunk.episodes})
    assert ids == [0, 1, 2, 100_000, 100_001, 100_002]


def test_stopped_in_mid_chunk(small_config):
    rollout = Rollout(small_config(), 0)
    rollout.load(0, initial_weights(small_config()))
    answers = iter([False, False, True])
    assert rollout.collect(0, lambda: next(answers)) is None


def test_times_are_parts_of_the_wall_time(small_config):
    """By a clock that moves by 1 with each reading: nothing is left out, nothing counts twice."""
    readings: list[float] = []

    def clock() -> float:
        readings.append(len(readings) + 1.0)
        return readings[-1]

    laps = Laps(clock)
    rollout, _ = collected(small_config(), laps=laps)
    laps.restart()
    begun = readings[-1]
    rollout.collect(1)
    seconds = laps.take()
    assert min(seconds[name] for name in ("simulate", "infer", "other")) > 0
    assert sum(seconds.values()) == readings[-1] - begun
    assert seconds["upload"] == seconds["fetch"] == seconds["wait"] == 0
    assert not any(value for name, value in laps.take().items() if name != "other")


def test_what_follows_a_step_is_taken_before_the_restart():
    """Of the worlds asked for: cut ones from before their restart, others from the present."""
    rng = np.random.default_rng(0)
    current, final = Observation.zeros(5), Observation.zeros(5)
    for rows in (current, final):
        rows.scan[:] = rng.integers(0, 65536, rows.scan.shape)
        rows.goal[:] = rng.normal(size=rows.goal.shape)
    before = current.copy()
    truncated = np.array([False, True, True, False, False])
    needed = np.array([True, False, True, False, True])
    result = StepResult(np.zeros(5, np.float32), ~truncated, truncated, final, [], np.zeros((5, 6)))
    rows = following(current, result, needed)
    for i, (source, row) in enumerate([(current, 0), (final, 2), (current, 4)]):
        assert_same(rows.take(i), source.take(row))
    assert_same(current, before)


def test_what_only_the_critic_sees_is_of_the_same_moments(small_config):
    """Beside every observation and final observation; the chunk is else as without it."""
    options = {"task": {"time_limit": 1.2}, "seed": 5}
    config = small_config(**options, learner={"privileged_critic": True})
    _, chunk = collected(config, index=2, first_episode=4)
    got = chunk.trajectory
    replay = VectorNavigation(config, first_world_of_actor(2), 2, first_episode=4, privileged=True)
    assert got.privileged is not None and replay.privileged is not None
    finals = []
    for t in range(8):
        np.testing.assert_array_equal(got.privileged[t], replay.privileged)
        result = replay.step(got.action[t])
        assert result.final_privileged is not None
        for b in range(2):
            if result.truncated[b]:
                finals.append(result.final_privileged[b].copy())
            elif t == 7 and not result.terminated[b]:
                finals.append(replay.privileged[b].copy())
    assert got.truncated[:-1].any() and len(finals) > 2
    np.testing.assert_array_equal(got.final_privileged, finals)
    plain = collected(small_config(**options), index=2, first_episode=4)[1].trajectory
    assert plain.privileged is None and plain.final_privileged is None
    arrays = got.to_arrays()
    for name, array in plain.to_arrays().items():
        np.testing.assert_array_equal(array, arrays[name], err_msg=name)
    read = Trajectory.from_arrays(arrays, config)
    np.testing.assert_array_equal(read.final_privileged, got.final_privileged)
