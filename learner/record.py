"""What a run leaves behind beside its weights: metrics.jsonl, TensorBoard events, a summary."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import OUTCOMES
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.view.metrics import read_metrics

_WINDOW = 200  # episodes behind every rate


class EpisodeWindow:
    """Outcomes of the newest episodes."""

    def __init__(self, count: int = 0) -> None:
        self.count = count
        self._recent: deque[EpisodeRecord] = deque(maxlen=_WINDOW)

    def add(self, episodes: Iterable[EpisodeRecord]) -> None:
        """Count finished episodes."""
        for episode in episodes:
            self._recent.append(episode)
            self.count += 1

    def figures(self) -> dict[str, float | int | None]:
        """Shares of the outcomes and means over the window; None while there is no episode."""
        recent = list(self._recent)

        def mean(values: list[float]) -> float | None:
            return sum(values) / len(values) if values else None

        figures: dict[str, float | int | None] = {"count": self.count, "window": len(recent)}
        for outcome in OUTCOMES:
            figures[outcome] = mean([float(e.outcome == outcome) for e in recent])
        figures["mean_return"] = mean([e.episode_return for e in recent])
        figures["mean_time"] = mean([e.time for e in recent if e.outcome == "arrived"])
        figures["mean_distance"] = mean([e.distance for e in recent if e.outcome == "arrived"])
        figures["position_error"] = mean([e.position_error for e in recent])
        figures["angle_error"] = mean([e.angle_error for e in recent])
        figures["variance_sum"] = mean([e.variance_sum for e in recent])
        return figures

    def reward_parts(self) -> dict[str, float | None]:
        """Mean sum of each part of the reward per episode."""
        recent = list(self._recent)
        return {
            part: sum(e.reward_parts[part] for e in recent) / len(recent) if recent else None
            for part in REWARD_PARTS
        }


class Recorder:
    """Appends one row per update to ``metrics.jsonl`` and TensorBoard.

    On resume, rows beyond the checkpoint (``updates``) are cut, so the file tells one history.
    """

    def __init__(self, folder: Path, updates: int) -> None:
        self._path = folder / "metrics.jsonl"
        # A new run has no file, and a resumed one may have lost it: neither stops the training.
        rows = read_metrics(self._path) if updates and self._path.exists() else []
        kept = [row for row in rows if row["update"] <= updates]
        self._path.write_text("".join(json.dumps(row) + "\n" for row in kept))
        # Slow to import, and needed by a learner alone.
        from torch.utils.tensorboard import SummaryWriter

        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=updates or None)

    def add(self, row: dict[str, Any]) -> None:
        """Write one row."""
        with self._path.open("a") as file:
            file.write(json.dumps(row) + "\n")
        for group in ("episodes", "reward_parts", "ppo", "lag", "time"):
            for name, value in row[group].items():
                if isinstance(value, int | float):
                    self._board.add_scalar(f"{group}/{name}", value, row["steps"])

    def close(self) -> None:
        """Flush everything."""
        self._board.close()


@dataclass(frozen=True)
class RunSummary:
    """How a run ended."""

    folder: Path
    finished: bool
    steps: int
    updates: int
    seconds: float
    episodes: dict[str, Any]
    dropped: dict[str, int]
    checkpoint: Path | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for ``summary.json``."""
        return {
            "folder": str(self.folder),
            "finished": self.finished,
            "steps": self.steps,
            "updates": self.updates,
            "seconds": round(self.seconds, 1),
            "steps_per_second": round(self.steps / max(self.seconds, 1e-9), 1),
            "episodes": self.episodes,
            "dropped": self.dropped,
            "checkpoint": str(self.checkpoint) if self.checkpoint else None,
        }

    def __str__(self) -> str:
        figures = self.episodes
        lines = [
            f"{'finished' if self.finished else 'stopped'} after {self.steps:,} steps in "
            f"{self.seconds / 60:.1f} min ({self.steps / max(self.seconds, 1e-9):.0f} steps/s), "
            f"{figures['count']:,} episodes"
        ]
        if figures["window"]:
            rates = ", ".join(f"{name} {figures[name]:.1%}" for name in OUTCOMES)
            lines.append(f"last {figures['window']} episodes: {rates}")
        lines.append(f"checkpoint: {self.checkpoint or 'none'}")
        if self.checkpoint:
            lines.append(f"next: lndrl evaluate {self.folder} --episodes 200")
        return "\n".join(lines)
