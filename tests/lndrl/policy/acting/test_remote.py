"""Acting the way a GPU does, on the CPU; the recorder of graphs is a stand-in."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.policy import PolicyRunner, build_policy, initial_weights, to_bytes
from lndrl.policy.acting.remote import DevicePolicy
from tests.lndrl.policy.test_networks import make_config, random_observation

CONFIG = make_config(map_channels=(4, 4, 4), features=16, goal_features=4)


class Recorder:
    """Records work without doing it, as CUDA does."""

    def __init__(self) -> None:
        self.recorded = 0

    def __call__(self, work):
        self.recorded += 1
        return work


def test_every_call_sees_its_own_observations_and_weights() -> None:
    runner, recorder = PolicyRunner(CONFIG), Recorder()
    policy = DevicePolicy(build_policy(CONFIG), CONFIG, record=recorder)
    runner.load(to_bytes(policy.network))
    for seed in range(8):
        if seed == 5:
            for each in (runner, policy):
                each.load(initial_weights(CONFIG.model_copy(update={"seed": 2})))
        observation = random_observation(np.random.default_rng(seed), 6, 2.0)
        answer = policy.log_probabilities(observation)
        np.testing.assert_allclose(
            answer, runner.log_probabilities(observation), rtol=1e-5, atol=1e-5
        )
    assert recorder.recorded == 1


def test_an_answer_outlives_the_next_call_and_sizes_come_and_go() -> None:
    recorder = Recorder()
    policy = DevicePolicy(build_policy(CONFIG), CONFIG, record=recorder)
    first_seen = random_observation(np.random.default_rng(0), 3, 2.0)
    first = policy.log_probabilities(first_seen)
    kept = first.copy()
    for size in (3, 1, 2, 4, 5, 6):
        answer = policy.log_probabilities(random_observation(np.random.default_rng(9), size, 3.0))
        assert answer.shape == (size, 28)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(policy.log_probabilities(first_seen), kept)


@pytest.mark.cuda
@pytest.mark.parametrize(("bfloat16", "tolerance"), [(False, 2e-3), (True, 0.1)])
def test_on_a_gpu_the_policy_is_the_same(bfloat16: bool, tolerance: float) -> None:
    here, there = PolicyRunner(CONFIG), PolicyRunner(CONFIG, "cuda", bfloat16)
    for runner in (here, there):
        runner.load(initial_weights(CONFIG))
    for seed in range(6):
        observation = random_observation(np.random.default_rng(seed), 64, 2.0)
        difference = here.log_probabilities(observation) - there.log_probabilities(observation)
        assert np.abs(difference).max() < tolerance
