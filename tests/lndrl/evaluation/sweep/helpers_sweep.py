"""Made-up sweeps and run folders for the tests of sweeps."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lndrl.evaluation.sweep import Sweep, SweepFolder, load_sweep
from lndrl.evaluation.sweep.folder import Run

ROOM = {
    "name": "room",
    "size": [6.0, 4.0],
    "pedestrians": {"count": [0, 0]},
    "robot": [{"start": [1, 1, 2, 3], "goal": [4, 1, 5, 3]}],
}
OUTCOMES = ("arrived", "collided", "lost", "timeout")


def sweep_file(folder: Path, name: str = "small", **changes: Any) -> Path:
    """Write a sweep of a bare room with the variants ``one`` and ``four``; returns its path."""
    (folder / "base.yaml").write_text(yaml.safe_dump({"scenario": ROOM}))
    data: dict[str, Any] = {
        "config": "base.yaml",
        "set": ["ppo.batch_size=64"],
        "steps": 1000,
        "seeds": [1, 2],
        "variants": {
            "one": {"set": ["ppo.epochs=1"], "why": "less"},
            "eight": {"set": ["ppo.epochs=8", "ppo.clip=0.1"], "why": "more"},
        },
    }
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump({**data, **changes}, sort_keys=False))
    return path


def small_sweep(folder: Path, **changes: Any) -> tuple[Sweep, SweepFolder]:
    """That sweep, loaded, and its folder ``work``."""
    sweep = load_sweep(sweep_file(folder, **changes))
    return sweep, SweepFolder(folder / "work", sweep)


def rows_of(
    outcomes: Sequence[str],
    steps: int,
    updates: int,
    sessions: Sequence[int] = (),
    returns: Callable[[int], float] = float,
    **ppo: float,
) -> list[dict[str, Any]]:
    """Metrics of a run in which episodes end evenly over ``steps``, window 200.

    ``sessions``: updates after which the run was resumed, and its window empty.
    """
    rows = []
    first = 0
    for update in range(1, updates + 1):
        count = len(outcomes) * update // updates
        begin = max(first, count - 200)
        window = outcomes[begin:count]

        def mean(values: list[float]) -> float | None:
            return float(np.mean(values)) if values else None

        rows.append(
            {
                "update": update,
                "steps": steps * update // updates,
                "episodes": {
                    "count": count,
                    "window": len(window),
                    **{o: mean([float(e == o) for e in window]) for o in OUTCOMES},
                    "mean_return": mean([returns(i) for i in range(begin, count)]),
                },
                "ppo": {"kl": 0.01, "entropy": 3.0, "explained_variance": 0.5, **ppo},
                "time": {"elapsed": 2.0 * update, "steps_per_second": 50.0},
            }
        )
        if update in sessions:
            first = count
    return rows


def write_run(
    folder: SweepFolder, run: Run, rows: list[dict[str, Any]], state: str = "finished"
) -> None:
    """What ``lndrl train`` leaves of a run that is ``state``."""
    place = folder.run_path(run)
    (place / "checkpoints" / f"step-{rows[-1]['steps']:09d}").mkdir(parents=True, exist_ok=True)
    folder.config_path(run).parent.mkdir(exist_ok=True)
    folder.config_path(run).write_text(run.config.to_yaml())
    (place / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (place / "summary.json").write_text(json.dumps({"finished": state == "finished"}))
    events = "2026-01-01 10:00:00 start      run x from scratch\n"
    if state == "diverged":
        events += "2026-01-01 10:01:00 diverged   loss nan\n"
    (place / "events.log").write_text(events)
