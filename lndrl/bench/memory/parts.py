"""An actor and a learner built step by step, each in a process that does nothing else."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

# What is measured is imported where it is: libraries are the first part.

_CHUNKS = "chunk.npz"

Steps = Callable[[Path, list[str]], Iterator[str]]


def main() -> None:
    """Print, as JSON, by how many MB memory grew with each step of a role.

    The command line has the role, the folder that both share and settings (key=value). A step
    yields the name of what it has made.
    """
    from lndrl.machine.memory import resident_megabytes

    role, folder, *settings = sys.argv[1:]
    steps: Steps = {"actor": actor, "learner": learner}[role]
    parts: dict[str, float] = {}
    before = 0.0
    for name in steps(Path(folder), settings):
        now = resident_megabytes()
        parts[name], before = now - before, now
    print(json.dumps(parts))


def actor(folder: Path, settings: list[str]) -> Iterator[str]:
    """As ``actors.worker`` builds one; leaves a chunk in ``folder`` for the learner."""
    from lndrl.machine.memory import return_large_blocks, return_what_is_free

    return_large_blocks()
    yield "interpreter"
    import numba  # noqa: F401
    import numpy as np

    yield "numpy and numba"
    from actors.rollout import Rollout
    from lndrl import transport  # noqa: F401
    from lndrl.bench.training import CONFIG
    from lndrl.config import load_config

    yield "other libraries"
    config = load_config(CONFIG, settings)
    rollout = Rollout(config, 0)
    return_what_is_free()
    yield "worlds, kernels, room for weights"
    rollout.load(0, _weights(folder))
    yield "weights"
    chunk = rollout.collect(0)
    assert chunk is not None
    yield "a chunk"
    arrays: dict[str, Any] = chunk.trajectory.to_arrays()
    np.savez(folder / _CHUNKS, **arrays)


def learner(folder: Path, settings: list[str]) -> Iterator[str]:
    """As ``learner.learner`` builds one, up to two updates with what an actor has left."""
    yield "interpreter"
    import torch  # noqa: F401

    yield "torch"
    import numpy as np

    import learner.service  # noqa: F401
    from learner.memory import keep_freed_memory, return_freed_memory
    from learner.ppo.batch import assemble
    from learner.ppo.update import PPO
    from lndrl.bench.training import CONFIG
    from lndrl.config import load_config
    from lndrl.machine.memory import return_what_is_free
    from lndrl.navigation import Trajectory

    yield "other libraries"
    keep_freed_memory()
    config = load_config(CONFIG, settings)
    ppo = PPO(config)
    return_what_is_free()  # as a MemoryTide does
    yield "networks"
    with np.load(folder / _CHUNKS) as file:
        chunk = Trajectory.from_arrays(dict(file), config)
    wanted = -(-config.ppo.batch_size // chunk.action.size)
    batch = assemble([chunk] * wanted)
    yield "a batch"
    ppo.update(batch, 0.0)
    return_freed_memory(ppo.each_thread)
    yield "moments and gradients"
    ppo.update(batch, 0.0)
    yield "activations, kept for the next update"
    ppo.close()


def _weights(folder: Path) -> bytes:
    """First weights, made by a process that may use torch."""
    import subprocess

    file = folder / "policy.safetensors"
    make = (
        "import sys; from pathlib import Path; from lndrl.bench.training import CONFIG; "
        "from lndrl.config import load_config; from lndrl.policy import initial_weights; "
        "Path(sys.argv[1]).write_bytes(initial_weights(load_config(CONFIG, sys.argv[2:])))"
    )
    subprocess.run([sys.executable, "-c", make, str(file), *sys.argv[3:]], check=True)
    return file.read_bytes()


if __name__ == "__main__":  # by its file: its room's own libraries would be counted
    main()
