"""``lndrl bench learner``: forward and backward of both networks on real observations."""

from __future__ import annotations

from typing import Any

import numpy as np

from learner.memory import keep_freed_memory
from learner.ppo.batch import Batch
from learner.ppo.update import PPO
from lndrl.bench.report import device_name, median_seconds
from lndrl.bench.scene import hybrid_config, observations
from lndrl.navigation import Observation

_SAMPLES = 1024


def measure(seconds: float, device: str = "cpu") -> dict[str, Any]:
    """``samples_per_second``: one sample is one forward and backward pass of both nets.

    The gradient steps (clipping, Adam) are included, as in training, with the minibatches of
    ``configs/lndrl.yaml`` and all cores, by reward alone; on a GPU the upload of the batch, too.
    ``people_in_view`` is the mean that the figure of a CPU depends on. Raises UserError when
    ``device`` is not there.
    """
    keep_freed_memory()
    plain = ["ppo.epochs=1", "ppo.teacher=null", "learner.privileged_critic=false"]
    config = hybrid_config([f"learner.device={device}", *plain])
    ppo = PPO(config)
    batch = batch_of(observations(config, _SAMPLES, 1)[0])
    generator = np.random.default_rng(0)
    advantage, target = generator.normal(size=(2, _SAMPLES)).astype(np.float32)
    try:
        once = median_seconds(lambda: ppo.train(batch, batch.log_prob, advantage, target), seconds)
    finally:
        ppo.close()
    return {
        "samples_per_second": _SAMPLES / once,
        "device": device_name(ppo.device),
        "people_in_view": float(batch.observation.pedestrian_count.mean()),
        "minibatch_size": config.ppo.minibatch_size,
        "precision": str(ppo.precision).removeprefix("torch."),
    }


def batch_of(observation: Observation) -> Batch:
    """A batch of ``observation`` (N,) with random actions, each as likely as the others."""
    count = len(observation)
    return Batch(
        trajectories=(),
        observation=observation,
        final_observation=observation.take(slice(0, 0)),
        action=np.random.default_rng(1).integers(0, 28, count),
        log_prob=np.full(count, -np.log(28.0), np.float32),
        version=np.zeros(count, np.int64),
    )
