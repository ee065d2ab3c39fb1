"""Kernels of the CPU, compiled before anything is timed: simulator, filter, teacher, acting."""

from __future__ import annotations

import numpy as np

from lndrl.ahead import compile_missing
from lndrl.bench.gpu.apart import apart, compiled
from lndrl.bench.gpu.parts import Tell
from lndrl.bench.gpu.plan import Plan
from lndrl.bench.scene import WORLDS, observations
from lndrl.evaluation.validation import ValidationEpisodes
from lndrl.policy import PolicyRunner, initial_weights


def measure(tell: Tell, deadline: float, plan: Plan) -> None:
    """Compile what is not kept yet, from both ends at once. See ``apart`` for what it raises."""
    apart(tell, deadline, (in_order, (plan,)), (from_behind, (plan,)))


def in_order(tell: Tell, plan: Plan) -> None:
    """Do what actors and evaluators do, in their order."""
    config = plan.config("learner.validation_episodes=1")
    met = observations(config, WORLDS, 1)[0]
    weights = initial_weights(config)
    runner = PolicyRunner(config)
    runner.load(weights)
    runner.act(met, np.random.default_rng(0))
    ValidationEpisodes(config, 1)(weights)
    tell(compiled(), "compiled", "in_order")


def from_behind(tell: Tell, plan: Plan) -> None:
    """Begin at the other end, with the teacher's and the learner's."""
    compile_missing(plan.config())
    tell(compiled(), "compiled", "from_behind")
