"""A run folder as a learner leaves it, with policies that are nothing but names."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from lndrl.config import load_config
from lndrl.transport.messages import COUNTS

MACHINE = "AMD EPYC, 2 cores, AVX2"


def counts(arrived: int) -> dict[str, int]:
    return {**dict.fromkeys(COUNTS, 0), "episodes": 4, "arrived": arrived, "lost": 4 - arrived}


def digits(policy: str) -> str:
    """By which episodes know the policy of this name."""
    return hashlib.sha256(policy.encode()).hexdigest()[:16]


def write_run(folder: Path, updates: int = 5, best: str = "best", newest: str = "newest") -> Path:
    """A run of ``updates`` of 100 steps and 60 s, whose version of step 200 was the best."""
    folder.mkdir(parents=True)
    config = load_config("lndrl", ["seed=7"])
    (folder / "config.yaml").write_text(config.to_yaml(), encoding="utf-8")
    (folder / "run.json").write_text(json.dumps({"run_id": "x", "version": "0.3"}))
    log = f"2026-12-01 04:56:20 start      run x\n2026-12-01 04:56:21 machine    {MACHINE}\n"
    (folder / "events.log").write_text(2 * log, encoding="utf-8")
    lines: list[object] = []
    for i in range(1, updates + 1):
        shares = {"count": 4 * i, "window": 4, "arrived": 0.25, "collided": 0.25, "lost": 0.5}
        lines.append(
            {
                "update": i,
                "steps": 100 * i,
                "episodes": {**shares, "timeout": 0.0, "mean_return": None, "position_error": 0.2},
                "ppo": {"kl": 0.01},
                "time": {"elapsed": 60.04 * i, "update": 1.0},
            }
        )
    for step, arrived in ((0, 0), (200, 3), (400, 2)):
        mark = {"version": step // 100, "steps": step, "unix": 1.0, "under": "c"}
        mark |= {"evaluator": "e", "sampled": counts(arrived), "greedy": counts(arrived)}
        lines.append({"update": step // 100, "validation": mark})
    (folder / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    for name, policy in (("best", best), ("step-000000500", newest)):
        place = folder / "checkpoints" / name
        place.mkdir(parents=True)
        (place / "policy.safetensors").write_text(policy)
    (folder / "checkpoints/best/validation.json").write_text(json.dumps({"steps": 200}))
    return folder
