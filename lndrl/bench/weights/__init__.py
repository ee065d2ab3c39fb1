"""``lndrl bench weights``: half precision on the way to actors, in bytes and in what it changes."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learner.ppo.update import PPO
from learner.run.checkpoint import start_from
from learner.sending import Sender
from lndrl.bench.learner import batch_of
from lndrl.bench.scene import hybrid_config, observations
from lndrl.config import RunConfig
from lndrl.config.shipped import SHIPPED_POLICY
from lndrl.navigation import Observation
from lndrl.policy import PolicyRunner, read_policy

_SAMPLES = 512
_BATCHES = 4
_KINDS = ("float32", "float16")


def measure(seconds: float) -> dict[str, Any]:
    """Figures of ``transport.weights`` float16 beside float32.

    The weights are the shipped policy's after eight gradient steps: its own were rounded once
    already. Of the observations that randomly driven worlds meet in hybrid: ``likeliest_agrees`` is
    the share whose likeliest action stays, ``total_variation`` (mean and largest) half the sum over
    actions of the probabilities' differences, ``kl`` the mean divergence of one from the other, and
    ``ratio_most`` the largest ratio of probabilities of a drawn action, which samples carry along.
    ``update_kl`` is what those eight steps themselves have changed, to compare with. Megabytes are
    10^6 bytes, times those of making a blob and of loading it, one core.
    """
    config = _config()
    seen = observations(config, _SAMPLES, _BATCHES)
    ppo = PPO(config)
    try:
        start_from(SHIPPED_POLICY, ppo)
        before = _answers(config, Sender(config, print)(ppo.policy, {}), seen)[0]
        _train(ppo, seen)
        blobs, figures = {}, {}
        for kind in _KINDS:
            transport = config.transport.model_copy(update={"weights": kind})
            sender = Sender(config.model_copy(update={"transport": transport}), print)
            began = perf_counter()
            blobs[kind] = sender(ppo.policy, {})
            made = perf_counter() - began
            figures[kind] = {"megabytes": len(blobs[kind]) / 1e6, "make_seconds": made}
    finally:
        ppo.close()
    answers = {}
    for kind, blob in blobs.items():
        answers[kind], figures[kind]["load_seconds"] = _answers(config, blob, seen)
    whole, rounded = (answers[kind] for kind in _KINDS)
    return {**figures, **effect(whole, rounded), "update_kl": _kl(before, whole)}


def _config() -> RunConfig:
    """That of the shipped policy, on hybrid and by reward alone."""
    own = read_policy(SHIPPED_POLICY).config
    plain = {"privileged_critic": False, "average": 0.0, "acting": "current"}
    return own.model_copy(
        update={
            "scenario": hybrid_config().scenario,
            "ppo": own.ppo.model_copy(update={"teacher": None, "epochs": 1}),
            "learner": own.learner.model_copy(update={**plain, "device": "cpu"}),
        }
    )


def effect(whole: NDArray[np.float64], rounded: NDArray[np.float64]) -> dict[str, float]:
    """How far log-probabilities (N, actions) of the two are apart; see ``measure``."""
    apart = 0.5 * np.abs(np.exp(whole) - np.exp(rounded)).sum(axis=1)
    drawn = (rounded + np.random.default_rng(1).gumbel(size=rounded.shape)).argmax(axis=1)[:, None]
    ratio = np.take_along_axis(whole - rounded, drawn, axis=1)
    return {
        "likeliest_agrees": float((whole.argmax(axis=1) == rounded.argmax(axis=1)).mean()),
        "total_variation_mean": float(apart.mean()),
        "total_variation_most": float(apart.max()),
        "kl": _kl(whole, rounded),
        "ratio_most": float(np.exp(np.abs(ratio).max())),
        "observations": len(whole),
    }


def _kl(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Mean of KL(first || second) over rows of log-probabilities."""
    return float((np.exp(first) * (first - second)).sum(axis=1).mean())


def _train(ppo: PPO, seen: list[Observation]) -> None:
    """Two gradient steps on each, by random advantages."""
    generator = np.random.default_rng(0)
    for observation in seen:
        batch = batch_of(observation)
        advantage, target = generator.normal(size=(2, len(batch))).astype(np.float32)
        ppo.train(batch, batch.log_prob, advantage, target)


def _answers(
    config: RunConfig, blob: bytes, seen: list[Observation]
) -> tuple[NDArray[np.float64], float]:
    """Log-probabilities (N, actions) under ``blob``, and the seconds that loading it took."""
    runner = PolicyRunner(config)
    began = perf_counter()
    runner.load(blob)
    took = perf_counter() - began
    found = np.concatenate([runner.log_probabilities(each) for each in seen])
    return found.astype(np.float64), took
