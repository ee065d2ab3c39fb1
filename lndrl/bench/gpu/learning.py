"""Gradient steps of both networks on the device: minibatches, precisions, CUDA graphs or none."""

from __future__ import annotations

import numpy as np
import torch

from learner.ppo.batch import Batch
from learner.ppo.update import PPO
from lndrl.bench.gpu.apart import compiled
from lndrl.bench.gpu.parts import Attempts, Tell
from lndrl.bench.gpu.plan import PRECISIONS, WAYS, Plan
from lndrl.bench.learner import batch_of
from lndrl.bench.report import median_seconds
from lndrl.bench.scene import observations
from lndrl.policy import EAGER_RUNS

_PLAIN = ("ppo.epochs=1", "ppo.teacher=null", "learner.privileged_critic=false")


def measure(tell: Tell, plan: Plan) -> None:
    """``samples_per_second``: forward and backward of both networks, Adam and the upload included.

    By precision, way and minibatch; ``megabytes`` (2^20 bytes) is the most memory of the device
    that any of them took. Raises UserError at the end where some could not be measured.
    """
    config = plan.config(*_PLAIN)
    # Rows repeat where there are fewer: what a dense network costs does not depend on them.
    met = observations(config, min(plan.observations, max(plan.minibatches)), 1)[0]
    batch = batch_of(met.take(np.arange(max(plan.minibatches)) % len(met)))
    attempts = Attempts(tell)
    for precision in PRECISIONS:
        for way, graphs in WAYS.items():
            for size in plan.minibatches:
                with attempts.one(precision, way, str(size)):
                    rate = _rate(plan, batch, precision, graphs, size)
                    tell(rate, "samples_per_second", precision, way, str(size))
    if plan.device != "cpu":
        tell(torch.cuda.max_memory_allocated() / 2**20, "megabytes")
    if late := compiled():
        tell(late, "kernels_compiled_late")
    attempts.settle()


def _rate(plan: Plan, batch: Batch, precision: str, graphs: bool, size: int) -> float:
    how = (f"learner.precision={precision}", f"learner.cuda_graphs={str(graphs).lower()}")
    config = plan.config(*_PLAIN, *how, f"ppo.minibatch_size={size}")
    ppo = PPO(config, dense=True)
    advantage, target = np.random.default_rng(0).normal(size=(2, len(batch))).astype(np.float32)

    def train() -> None:
        ppo.train(batch, batch.log_prob, advantage, target)

    try:
        for _ in range(EAGER_RUNS):  # the next step of each size is recorded
            train()
        return len(batch) / median_seconds(train, plan.seconds)
    finally:
        ppo.close()
