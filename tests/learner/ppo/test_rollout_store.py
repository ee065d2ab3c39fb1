"""Memory of batches: used again, grown when needed, the same contents as a fresh copy."""

from __future__ import annotations

import numpy as np

from learner.ppo.batch import assemble
from learner.ppo.rollout_store import RolloutStore
from lndrl.navigation import Observation
from tests.learner.helpers_learner import random_trajectory, small_config


def test_memory_is_used_again_and_grows() -> None:
    config, store = small_config(), RolloutStore()
    large = [random_trajectory(config, seed, steps=6, worlds=3) for seed in (1, 2, 3)]
    first = assemble(large[:2], store)
    address = first.observation.scan.ctypes.data
    second = assemble(large[1:], store)
    assert second.observation.scan.ctypes.data == address
    third = assemble(large, store)
    assert third.observation.scan.ctypes.data != address
    assert len(third) == 54
    again = assemble(large, store)
    assert again.observation.scan.ctypes.data == third.observation.scan.ctypes.data


def test_contents_are_those_of_the_chunks() -> None:
    config, store = small_config(), RolloutStore()
    assemble([random_trajectory(config, 9, steps=20, worlds=4)], store)  # leaves its rests behind
    chunks = [random_trajectory(config, seed, version=seed) for seed in (4, 5)]
    batch = assemble(chunks, store)
    expected = Observation.concatenate([t.observation.flatten() for t in chunks])
    finals = Observation.concatenate([t.final_observation for t in chunks])
    for made, given in ((batch.observation, expected), (batch.final_observation, finals)):
        for name, array in vars(given).items():
            np.testing.assert_array_equal(getattr(made, name), array)
    for name in ("action", "log_prob", "version"):
        joined = np.concatenate([getattr(t, name).reshape(-1) for t in chunks])
        np.testing.assert_array_equal(getattr(batch, name), joined)
    assert (batch.action.dtype, batch.version.dtype) == (np.dtype(np.int64),) * 2


def test_privileged_floats_lie_beside_their_observations() -> None:
    config, store = small_config(learner={"privileged_critic": True}), RolloutStore()
    assemble([random_trajectory(config, 9, steps=20, worlds=4)], store)
    chunks = [random_trajectory(config, seed) for seed in (4, 5)]
    batch = assemble(chunks, store)
    assert batch.privileged is not None and batch.final_privileged is not None
    for i, (made, name) in enumerate(
        ((batch.privileged, "privileged"), (batch.final_privileged, "final_privileged"))
    ):
        expected = np.concatenate([getattr(t, name).reshape(-1, made.shape[1]) for t in chunks])
        np.testing.assert_array_equal(made, expected)
        assert len(made) == len((batch.observation, batch.final_observation)[i])
    place = batch.privileged.ctypes.data
    assert assemble(chunks[:1], store).privileged.ctypes.data == place  # type: ignore[union-attr]
    assert assemble([random_trajectory(small_config(), 1)], store).privileged is None
