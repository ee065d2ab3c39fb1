"""``lndrl bench ranks``: gradient steps of two ranks on a core each beside one rank on one core."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from lndrl.bench.scene import hybrid_config, observations, settings
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.cores import THREAD_VARIABLES, allowed_cores
from lndrl.machine.ports import free_port

MINIBATCH = 1024
_COLUMNS = ("scan", "pedestrians", "pedestrian_count", "goal")
_STEPS = 2  # gradient steps of a turn
_RANKS = 2
_LEAST_TURNS = 5


def measure(seconds: float) -> dict[str, Any]:
    """``speedup``: minibatches of 1,024 by two ranks over those of one, the median over turns.

    Every rank is held to a core of its own, also the one that is alone. Each trains the same
    networks on the same observations, forward, backward and Adam; turns of both follow one another
    for ``2 * seconds``, because a shared machine changes its speed. ``loss_difference`` is that of
    the losses of the first turn, relative. ``missing`` says so where there are no two cores. Raises
    UserError when a rank fails.
    """
    cores = allowed_cores()
    if len(cores) < _RANKS:
        return {"missing": f"needs {_RANKS} cores, this process may use {len(cores)}"}
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as place, ExitStack() as stack:
        file = Path(place) / "observations.npz"
        config = hybrid_config(["ppo.teacher=null", "learner.privileged_critic=false"])
        seen = observations(config, MINIBATCH, _STEPS)
        columns = [[getattr(each, name) for each in seen] for name in _COLUMNS]
        np.savez(file, *map(np.concatenate, columns))
        alone = [stack.enter_context(_Worker(file, cores[0]))]
        port = free_port("127.0.0.1")
        both = [stack.enter_context(_Worker(file, cores[r], r, port)) for r in range(_RANKS)]
        return _turns(alone, both, 2.0 * seconds)


def _turns(alone: Sequence[_Worker], both: Sequence[_Worker], seconds: float) -> dict[str, Any]:
    """Turns of one and of two ranks, after one of each to warm up."""
    first = [_turn(workers) for workers in (alone, both)]
    losses = [word["losses"] for word in first]
    pairs: list[tuple[float, float]] = []
    while len(pairs) < _LEAST_TURNS or sum(map(sum, pairs)) < seconds:
        pairs.append((_turn(alone)["seconds"], _turn(both)["seconds"]))
    ratios = [one / two for one, two in pairs]
    samples = MINIBATCH * _STEPS
    return {
        "speedup": statistics.median(ratios),
        "speedup_least": min(ratios),
        "speedup_most": max(ratios),
        "turns": len(pairs),
        "one_rank_samples_per_second": samples / statistics.median(one for one, _ in pairs),
        "two_ranks_samples_per_second": samples / statistics.median(two for _, two in pairs),
        "loss_difference": max(
            abs(one - two) / max(abs(one), 1e-12) for one, two in zip(*losses, strict=True)
        ),
        "minibatch_size": MINIBATCH,
    }


def _turn(workers: Sequence[_Worker]) -> dict[str, Any]:
    """What rank 0 says of a turn that all of ``workers`` take at once; the slowest one's time."""
    for worker in workers:
        worker.go()
    words = [worker.word() for worker in workers]
    return {**words[0], "seconds": max(word["seconds"] for word in words)}


class _Worker:
    """A process of ``worker.py`` that is held to ``core``; a ``rank`` of two where one is given."""

    def __init__(self, file: Path, core: int, rank: int | None = None, port: int = 0) -> None:
        self._what = "one rank" if rank is None else f"rank {rank} of {_RANKS}"
        job = {}
        if rank is not None:
            job = {"RANK": str(rank), "WORLD_SIZE": str(_RANKS), "MASTER_ADDR": "127.0.0.1"}
            job["MASTER_PORT"] = str(port)
        script = str(Path(__file__).with_name("worker.py"))
        self._process = subprocess.Popen(
            [sys.executable, script, str(file), str(core), *settings()],
            env=this_program() | dict.fromkeys(THREAD_VARIABLES, "1") | job,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
        )

    def __enter__(self) -> _Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def go(self) -> None:
        """Let it take a turn."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write("go\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            self.word()

    def word(self) -> dict[str, Any]:
        """What it says of the turn; raises UserError where it has ended."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise UserError(f"bench ranks: {self._what} ended early; it says why above")
        found: dict[str, Any] = json.loads(line)
        return found
