"""``lndrl bench memory``: what an actor and a learner hold, by part, and in a training."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from lndrl.bench.scene import settings
from lndrl.bench.training import WARM_UPDATES, Rows, Training, span
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.cores import THREAD_VARIABLES

_LOOK = 0.1  # s between two looks at a training: weights come and go in less than a second
_LEAST_UPDATES = 4


def measure(seconds: float) -> dict[str, Any]:
    """Resident memory in MB (2^20 bytes) of an ``actor`` and a ``learner``.

    By part: each of both is built in a process of its own, step by step, and a part is what memory
    has grown by. ``in_training`` are the medians and the largest values of ``lndrl train``, which
    runs until ``12 * seconds`` of updates have passed; of actors, that of the one that has most at
    the time. They hold what links take, too. Raises UserError when a process fails.
    """
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as place:
        folder = Path(place)
        figures: dict[str, Any] = {
            role: _parts(role, folder) for role in ("actor", "learner")
        }  # the learner learns from what the actor has collected
        figures["in_training"] = _training(seconds, folder)
    return figures


def _parts(role: str, folder: Path) -> dict[str, float]:
    """What ``parts.ROLE`` finds in a process of its own."""
    script = Path(__file__).with_name("parts.py")
    limits = dict.fromkeys(THREAD_VARIABLES, "1") if role == "actor" else {}
    done = subprocess.run(
        [sys.executable, str(script), role, str(folder), *settings()],
        env=this_program() | limits,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        raise UserError(f"bench memory: the {role} ended early ({last})")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found | {"all": sum(found.values())}


def _training(seconds: float, folder: Path) -> dict[str, float]:
    seen: dict[str, list[float]] = {"actor": [], "learner": []}

    def done(rows: Rows) -> bool:
        if len(rows) < WARM_UPDATES:
            return False
        learner, actor = training.megabytes()
        seen["actor"].append(actor)
        seen["learner"].append(learner)
        timed = rows[WARM_UPDATES - 1 :]
        return len(timed) > _LEAST_UPDATES and span(timed) >= 12.0 * seconds

    more = [part for each in settings() for part in ("--set", each)]
    with Training("bench memory", folder, "tcp", more) as training:
        training.wait(done, _LOOK)
    return {
        f"{role}_{name}": find(values)
        for role, values in seen.items()
        for name, find in (("median", statistics.median), ("largest", max))
    }
