"""One rank of ``lndrl bench ranks``: a turn of gradient steps for every line that comes."""

from __future__ import annotations

import json
import os
import sys
from time import perf_counter

import numpy as np

if __name__ == "__main__":
    os.sched_setaffinity(0, {int(sys.argv[2])})  # before torch counts cores

    from learner.memory import keep_freed_memory
    from learner.ppo.team import Team
    from learner.ppo.update import PPO
    from lndrl.bench.learner import batch_of
    from lndrl.bench.ranks import MINIBATCH
    from lndrl.bench.scene import hybrid_config, with_settings
    from lndrl.navigation import Observation

    keep_freed_memory()
    team = Team.of_environment()
    with np.load(sys.argv[1]) as kept, with_settings(sys.argv[3:]):
        seen = Observation(*kept.values())
        plain = ["ppo.epochs=1", "ppo.teacher=null", "learner.privileged_critic=false"]
        config = hybrid_config([*plain, f"ppo.minibatch_size={MINIBATCH}"])
    ppo = PPO(config, team=team)
    batch = batch_of(seen)
    advantage, target = np.random.default_rng(0).normal(size=(2, len(batch))).astype(np.float32)
    for _ in sys.stdin:
        began = perf_counter()
        figures = ppo.train(batch, batch.log_prob, advantage, target)
        took = perf_counter() - began
        losses = [figures["policy_loss"], figures["value_loss"]]
        print(json.dumps({"seconds": took, "losses": losses}), flush=True)
