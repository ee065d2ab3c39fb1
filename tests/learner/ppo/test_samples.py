"""Inputs that both networks share, and the batch on a device."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
import torch

from learner.ppo.batch import assemble
from learner.ppo.samples import DeviceSamples, Samples, SharedInputs
from tests.learner.helpers_learner import random_trajectory, small_config


class Maker:
    def __init__(self) -> None:
        self.calls: list[Any] = []

    def __call__(self, key, rows):
        self.calls.append(key)
        return (key, rows)


def test_two_readers_make_everything_once() -> None:
    maker = Maker()
    shared = SharedInputs(maker, readers=2)
    keys = [(epoch, i) for epoch in range(50) for i in range(8)]
    results: list[list[object]] = []

    def read() -> None:
        results.append([shared.get(key, slice(0, 1)) for key in keys])

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(maker.calls) == keys
    assert all(one is other for one, other in zip(*results, strict=True))
    assert not shared._made


def test_one_who_left_is_not_kept_for() -> None:
    maker = Maker()
    shared = SharedInputs(maker, readers=2)
    shared.get(1, slice(0, 1))
    shared.leave()
    shared.get(1, slice(0, 1))  # was made for the one who stays
    shared.get(2, slice(0, 1))
    assert maker.calls == [1, 2]
    assert not shared._made


def test_what_fails_for_one_fails_for_both() -> None:
    def fail(key, rows):
        raise ValueError("no inputs")

    shared = SharedInputs(fail, readers=2)
    for _ in range(2):
        with pytest.raises(ValueError, match="no inputs"):
            shared.get(0, slice(0, 1))


def test_device_memory_stays_until_a_larger_batch_comes() -> None:
    config = small_config()
    samples = DeviceSamples(config, torch.device("cpu"))
    batches = [
        assemble([random_trajectory(config, seed, steps=steps)])
        for seed, steps in enumerate((8, 6, 9))
    ]
    assert [samples.load(batch) for batch in batches] == [True, False, True]
    address = samples.action.data_ptr()
    assert not samples.load(batches[1])
    assert samples.action.data_ptr() == address
    count = len(batches[1])
    values = np.arange(count, dtype=np.float32)
    samples.set_goals(torch.from_numpy(values), 2 * values, 3 * values)
    rows = torch.tensor([3, 0, count - 1])
    assert samples.target[rows].tolist() == (3 * values[rows.numpy()]).tolist()
    np.testing.assert_array_equal(samples.action[:count].numpy(), batches[1].action)
    inputs = samples.inputs(None, rows)
    expected = batches[1].observation.scan[rows.numpy()] / 65535
    np.testing.assert_allclose(inputs.scan.numpy(), expected, rtol=1e-6)
    final = samples.final_inputs(None, slice(0, 2))
    np.testing.assert_array_equal(final.goal.numpy(), batches[1].final_observation.goal[:2])


@pytest.mark.parametrize("on_device", [False, True])
def test_privileged_floats_come_with_the_inputs_of_their_rows(on_device: bool) -> None:
    config = small_config(learner={"privileged_critic": True})
    samples = DeviceSamples(config, torch.device("cpu")) if on_device else Samples(config)
    large, small = (
        assemble([random_trajectory(config, seed, steps=steps)])
        for seed, steps in enumerate((9, 6))
    )
    samples.load(large)
    samples.load(small)
    assert small.privileged is not None and small.final_privileged is not None
    for rows in (slice(2, 5), torch.tensor([3, 0, len(small) - 1])):
        index = rows if isinstance(rows, slice) else rows.numpy()
        got = samples.inputs("a", rows).privileged
        assert got is not None
        np.testing.assert_array_equal(got.numpy(), small.privileged[index])
    final = samples.final_inputs("b", slice(0, 2)).privileged
    assert final is not None
    np.testing.assert_array_equal(final.numpy(), small.final_privileged[:2])
    plain = DeviceSamples(small_config(), torch.device("cpu")) if on_device else Samples(config)
    plain.load(assemble([random_trajectory(small_config(), 0)]))
    assert plain.inputs("a", slice(0, 2)).privileged is None
