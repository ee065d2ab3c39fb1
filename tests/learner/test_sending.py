"""Weights in half precision on the way to actors, and whole everywhere else."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from learner.sending import Sender
from lndrl.policy import Guidance, PolicyRunner, build_policy, to_bytes
from lndrl.policy.blob import tensors_in
from tests.learner.helpers_learner import random_observations, small_config
from tests.learner.test_learner import Run, start

assert start is not None  # the fixture
HALF = {"weights": "float16"}


def test_half_the_bytes_say_nearly_the_same() -> None:
    config = small_config(transport=HALF)
    policy = build_policy(config)
    whole, half = to_bytes(policy), Sender(config, pytest.fail)(policy, {})
    assert len(half) < 0.6 * len(whole)
    assert {t.dtype for t in tensors_in(half).values()} == {np.dtype(np.float16)}
    seen = random_observations(config, np.random.default_rng(1), (200,))
    answers = []
    for blob in (whole, half):
        runner = PolicyRunner(config)
        runner.load(blob)
        answers.append(runner.log_probabilities(seen))
    apart = np.abs(answers[0] - answers[1]).max()
    assert 0.0 < apart < 0.01


def test_float32_goes_as_it_is() -> None:
    config = small_config()
    policy = build_policy(config)
    assert Sender(config, pytest.fail)(policy, {}) == to_bytes(policy, {})


def test_numbers_that_half_precision_lacks_go_whole_and_that_is_said_once() -> None:
    config = small_config(transport=HALF)
    policy = build_policy(config)
    with torch.no_grad():
        next(policy.parameters())[0] = 1e5
    told: list[str] = []
    sender = Sender(config, told.append)
    for _ in range(2):
        assert sender(policy, {}) == to_bytes(policy, {})
    (text,) = told
    assert text.startswith("sent in float32 after all, weights: ") and "65504" in text


def test_actors_get_half_evaluators_and_checkpoints_all(start) -> None:
    run: Run = start(transport=HALF, learner={"validation_episodes": 10})
    version, blob = run.actor.fetch()
    assert version == 0 and Guidance.of(blob) == Guidance()
    whole = to_bytes(run.learner.ppo.policy)
    assert len(blob) < 0.6 * len(whole)
    offer = run.learner.validation._newest
    assert offer is not None and tensors_in(offer.weights).keys() == tensors_in(blob).keys()
    assert {t.dtype for t in tensors_in(offer.weights).values()} == {np.dtype(np.float32)}
    kept = run.learner.folder.checkpoints / "step-000000000" / "policy.safetensors"
    assert {t.dtype for t in tensors_in(kept.read_bytes()).values()} == {np.dtype(np.float32)}
