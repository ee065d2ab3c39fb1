"""What a learner imports before it trains: every module more and it is back later after a crash."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

UPDATE = """
    import sys
    from tests.learner.helpers_learner import random_trajectory, small_config
    import learner.service
    from learner.ppo.batch import assemble
    from learner.ppo.update import PPO

    ppo = PPO(small_config())
    ppo.update(assemble([random_trajectory(ppo.config, 0)]), 0.0)
    print(*(name for name in sys.argv[1:] if name in sys.modules))
"""
COMPILER = ("torch._dynamo", "torch._inductor", "sympy")
SIMULATOR = ("lndrl.world", "lndrl.localization", "pymunk", "scipy.ndimage", "scipy.sparse")


def test_an_update_needs_neither_compiler_nor_simulator() -> None:
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(UPDATE), *COMPILER, *SIMULATOR],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(root)},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
