"""The policy's inference on the device: batches, precisions, with and without CUDA graphs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from lndrl.bench.gpu.apart import compiled
from lndrl.bench.gpu.parts import Attempts, Tell
from lndrl.bench.gpu.plan import PRECISIONS, WAYS, Plan
from lndrl.bench.policy import acting_rate
from lndrl.bench.scene import observations
from lndrl.config import RunConfig
from lndrl.machine.threads import set_threads
from lndrl.policy import EAGER_RUNS, PolicyRunner, build_policy, initial_weights, resolve_device
from lndrl.policy.acting.remote import DevicePolicy


def measure(tell: Tell, plan: Plan) -> None:
    """``samples_per_second`` of ``PolicyRunner.act`` by one thread, upload and sampling included.

    By precision, way and batch; ``difference`` is the largest of a log-probability to the CPU's, by
    precision and way. Raises UserError at the end where some could not be measured.
    """
    set_threads(1)
    config = plan.config()
    met = observations(config, plan.observations, 1)[0]
    weights = initial_weights(config)
    reference = PolicyRunner(config)
    reference.load(weights)
    rows = met.take(np.arange(min(plan.batches[0], len(met))))
    expected = reference.log_probabilities(rows)
    attempts = Attempts(tell)
    for precision in PRECISIONS:
        for way, graphs in WAYS.items():
            runner = _runner(config, plan, getattr(torch, precision), graphs)
            runner.load(weights)
            with attempts.one("difference", precision, way):
                answers = [runner.log_probabilities(rows) for _ in range(EAGER_RUNS + 2)]
                difference = max(float(np.abs(answer - expected).max()) for answer in answers)
                tell(difference, "difference", precision, way)
            for batch in plan.batches:
                with attempts.one(precision, way, str(batch)):
                    rate = acting_rate(runner, met, batch, plan.seconds)
                    tell(rate, "samples_per_second", precision, way, str(batch))
    if late := compiled():
        tell(late, "kernels_compiled_late")
    attempts.settle()


def _runner(config: RunConfig, plan: Plan, precision: torch.dtype, graphs: bool) -> PolicyRunner:
    """A runner whose policy works as on a GPU, wherever it is."""
    network = build_policy(config, initialize=False).to(resolve_device(plan.device))
    network = network.requires_grad_(False).eval()
    runner = PolicyRunner(config)
    runner.policy = DevicePolicy(network, config, precision, None if graphs else _as_it_is)
    return runner


def _as_it_is(work: Callable[[], None]) -> Callable[[], None]:
    """Stands in for the recorder: the work is done operation by operation every time."""
    return work
