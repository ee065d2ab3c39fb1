"""What a run folder says of its run, read without disturbing whoever trains in it."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from learner.run.best import read_best
from learner.run.lines import backwards
from lndrl.config import RunConfig, load_config
from lndrl.errors import UserError
from lndrl.machine.lock import LOCK_FILE
from lndrl.numbering import by_number, checkpoints_in

TRAINING, FINISHED, STOPPED, EMPTY, DAMAGED = (
    *("training", "finished", "stopped", "empty", "damaged"),
)
"""How a run stands: a learner holds its folder; its steps are done; it can be resumed; it has no
checkpoint to go on from; its configuration cannot be read."""

_OUTCOMES = ("arrived", "collided", "lost", "timeout")


@dataclass(frozen=True)
class Overview:
    """One run; figures are None where nothing says them.

    ``episodes`` and the shares are those of the newest update, over its window of episodes.
    ``validated``: share of sampled arrivals of the best validated policy, of ``validated_of``
    episodes. ``unix``: when it last wrote (s). ``size``: bytes of the folder. ``why``: what is
    damaged, in words.
    """

    name: str
    folder: str
    state: str
    scenario: str
    teacher: str | None
    steps: int
    total: int | None
    episodes: int
    arrived: float | None
    collided: float | None
    lost: float | None
    timeout: float | None
    mean_return: float | None
    validated: float | None
    validated_of: int | None
    checkpoint: str | None
    unix: float
    size: int
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain types."""
        return asdict(self)


def overviews(root: Path) -> list[Overview]:
    """Of every run folder in ``root``, the one that wrote last first; none where there is none."""
    found = [overview(path.parent) for path in root.glob("*/run.json")]
    return sorted(found, key=lambda run: (-run.unix, by_number(run.name)))


def overview(folder: Path) -> Overview:
    """Of one run; raises UserError for what is no run folder."""
    if not (folder / "run.json").is_file():
        raise UserError(f"{folder}: is no run folder of lndrl (it has no run.json)")
    config, why = _config_of(folder)
    kept = checkpoints_in(folder / "checkpoints")
    row = last_row(folder / "metrics.jsonl") or {}
    episodes = _map(row.get("episodes"))
    best = _best(folder)
    sampled = _map(best.get("sampled"))
    return Overview(
        name=folder.name,
        folder=str(folder),
        state=_state(folder, bool(kept), config),
        scenario=config.scenario.name if config else "",
        teacher=config.ppo.teacher if config else None,
        steps=int(_number(row.get("steps")) or 0),
        total=config.learner.total_steps if config else None,
        episodes=int(_number(episodes.get("count")) or 0),
        **{name: _number(episodes.get(name)) for name in _OUTCOMES},
        mean_return=_number(episodes.get("mean_return")),
        validated=_share(sampled),
        validated_of=sampled.get("episodes"),
        checkpoint=kept[-1].name if kept else None,
        unix=_written(folder),
        size=_size(folder),
        why=why,
    )


def is_held(folder: Path) -> bool:
    """Whether a learner works in ``folder`` now; it is not disturbed, and nothing is written."""
    try:
        descriptor = os.open(folder / LOCK_FILE, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False


def last_row(path: Path) -> dict[str, Any] | None:
    """The newest whole row of an update in a ``metrics.jsonl``; None where there is none."""
    try:
        with path.open("rb") as file:
            for _, line in backwards(file):
                row = _row(line)
                if row is not None:
                    return row
    except OSError:
        return None
    return None


def row_at(rows: Iterable[Mapping[str, Any]], steps: int) -> Mapping[str, Any] | None:
    """The last of ``rows``, oldest first, that had taken at most ``steps`` environment steps."""
    found = None
    for row in rows:
        taken = _number(row.get("steps"))
        if taken is not None and taken <= steps:
            found = row
    return found


def _state(folder: Path, resumable: bool, config: RunConfig | None) -> str:
    if is_held(folder):
        return TRAINING
    if config is None:
        return DAMAGED
    try:
        summary = json.loads((folder / "summary.json").read_text("utf-8"))
        finished = summary["finished"] is True
    except (OSError, ValueError, KeyError, TypeError):
        finished = False
    # A finished run that went on with more steps, and was killed, has its older summary.
    done = int(_number((last_row(folder / "metrics.jsonl") or {}).get("steps")) or 0)
    if finished and done <= int(summary.get("steps", 0)):
        return FINISHED
    return STOPPED if resumable else EMPTY


def _config_of(folder: Path) -> tuple[RunConfig | None, str]:
    try:
        return load_config(folder / "config.yaml"), ""
    except UserError as error:
        return None, str(error)


def _best(folder: Path) -> dict[str, Any]:
    try:
        return read_best(folder / "checkpoints") or {}
    except ValueError:
        return {}


def _share(sampled: Mapping[str, Any]) -> float | None:
    arrived, episodes = _number(sampled.get("arrived")), _number(sampled.get("episodes"))
    return arrived / episodes if arrived is not None and episodes else None


def _row(line: bytes) -> dict[str, Any] | None:
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return row if isinstance(row, dict) and "update" in row and "validation" not in row else None


def _map(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and type(value) is not bool else None


def _written(folder: Path) -> float:
    """When the run last wrote what every run writes (s since 1970)."""
    times = []
    for name in ("metrics.jsonl", "events.log", "run.json"):
        try:
            times.append((folder / name).stat().st_mtime)
        except OSError:
            continue
    return max(times, default=0.0)


def _size(folder: Path) -> int:
    total = 0
    for parent, _, files in os.walk(folder):
        for name in files:
            try:
                total += os.lstat(os.path.join(parent, name)).st_size
            except OSError:  # a checkpoint that makes room for a newer one
                continue
    return total
