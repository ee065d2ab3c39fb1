"""What a run leaves behind beside its weights: metrics.jsonl, TensorBoard events, a summary."""

from __future__ import annotations

import json
import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from learner.run.lines import LineFile, backwards
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import OUTCOMES
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.view.run_rows import scalars_of
from lndrl.wording import counted

_WINDOW = 200  # episodes behind every rate


class EpisodeWindow:
    """Outcomes of the newest episodes; ``terms`` are the names of the run's own reward terms."""

    def __init__(self, count: int = 0, terms: Sequence[str] = ()) -> None:
        self.count = count
        self._parts = (*REWARD_PARTS, *terms)
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
            for part in self._parts
        }


class Recorder:
    """Appends rows to ``metrics.jsonl`` and TensorBoard, one per update and per validated version.

    Never raises.

    On resume, rows beyond the checkpoint (``updates``) are cut, so the file tells one history.
    ``on_change(what, error)`` hears that the disk refuses, and with None that it works again.
    """

    def __init__(
        self,
        folder: Path,
        updates: int,
        on_change: Callable[[str, OSError | None], None] = lambda what, error: None,
    ) -> None:
        self._on_change = on_change
        path = folder / "metrics.jsonl"
        try:
            _cut(path, updates)
        except OSError as error:
            on_change(path.name, error)
        self._file = LineFile(path, partial(on_change, path.name), keep=1000)
        self._file.flush()
        self._folder = folder / "tensorboard"
        self._board: Any = None
        self._board_refused = False
        self._open_board(updates)

    def add(self, row: dict[str, Any]) -> None:
        """Write one row; numbers that are not finite become null."""
        try:
            line = json.dumps(row, allow_nan=False)
        except ValueError:
            line = json.dumps(_finite(row), allow_nan=False)
        self._file.add(line)
        if self._board is None:
            self._open_board(row["update"] - 1)
        if self._board is not None:
            self._on_board(lambda board: _add_scalars(board, row))

    def add_validation(self, row: dict[str, Any], updates: int) -> None:
        """Write one row of the validated curve, which came after so many updates."""
        self._file.add(json.dumps(_finite({"update": updates, "validation": row})))
        if self._board is None:
            self._open_board(updates)
        if self._board is not None:
            self._on_board(lambda board: _add_validated(board, row))

    def close(self) -> None:
        """Flush everything."""
        self._file.close()
        if self._board is not None:
            self._on_board(lambda board: board.close())

    def _open_board(self, updates: int) -> None:
        # Slow to import, and needed by a learner alone.
        from torch.utils.tensorboard import SummaryWriter

        try:
            self._board = SummaryWriter(str(self._folder), purge_step=updates or None)
        except OSError as error:
            self._refused(error)
        else:
            if self._board_refused:
                self._board_refused = False
                self._on_change("tensorboard/", None)

    def _on_board(self, work: Callable[[Any], None]) -> None:
        # Its own thread writes; what that one met is raised here, by any of its methods.
        try:
            work(self._board)
        except Exception as error:
            self._board = None
            self._refused(error if isinstance(error, OSError) else OSError(str(error)))

    def _refused(self, error: OSError) -> None:
        if not self._board_refused:
            self._board_refused = True
            self._on_change("tensorboard/", error)


def quiet_tensorboard() -> None:
    """Keep TensorBoard's own thread from printing a traceback when the disk refuses.

    For the whole process. The Recorder hears of it anyway, and says so in a line.
    """
    usual = threading.excepthook

    def hook(what: threading.ExceptHookArgs) -> None:
        theirs = type(what.thread).__module__.partition(".")[0] == "tensorboard"
        if not (theirs and isinstance(what.exc_value, OSError)):
            usual(what)

    threading.excepthook = hook


def _cut(path: Path, updates: int) -> None:
    """Cut a file of rows after the last one up to ``updates``; needs no room on the disk."""
    if not updates or not path.exists():
        path.write_text("", encoding="utf-8")
        return
    with path.open("rb+") as file:
        # From the end: there may be days of rows before the one that is looked for.
        ends = (end for end, line in backwards(file) if _update_of(line) <= updates)
        file.truncate(next(ends, 0))


def _update_of(line: bytes) -> float:
    """The number of a row's update; infinite for what is no row."""
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return math.inf  # the disk was full half-way through it
    number = row.get("update") if isinstance(row, dict) else None
    return number if isinstance(number, int) else math.inf


def _add_scalars(board: Any, row: dict[str, Any]) -> None:
    for name, value in scalars_of(row).items():
        board.add_scalar(name, value, row["steps"])


def _add_validated(board: Any, row: dict[str, Any]) -> None:
    """Shares of the outcomes and the 95 % interval of arrivals, at the step that was validated."""
    for name, value in scalars_of({"validation": row}).items():
        board.add_scalar(name, value, row["steps"])


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True)
class RunSummary:
    """How a run ended; ``early`` says why it is finished before its steps, empty where not."""

    folder: Path
    finished: bool
    steps: int
    updates: int
    seconds: float
    episodes: dict[str, Any]
    dropped: dict[str, int]
    accounts: dict[str, Any]
    checkpoint: Path | None
    early: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data for ``summary.json``."""
        return {
            "folder": str(self.folder),
            "finished": self.finished,
            "early": self.early,
            "steps": self.steps,
            "updates": self.updates,
            "seconds": round(self.seconds, 1),
            "steps_per_second": round(self.steps / max(self.seconds, 1e-9), 1),
            "episodes": self.episodes,
            "dropped": self.dropped,
            "accounts": self.accounts,
            "checkpoint": str(self.checkpoint) if self.checkpoint else None,
        }

    def __str__(self) -> str:
        figures = self.episodes
        lines = [
            f"{'finished' if self.finished else 'stopped'} after {counted(self.steps, 'step')} in "
            f"{self.seconds / 60:.1f} min ({self.steps / max(self.seconds, 1e-9):.0f} steps/s), "
            f"{counted(figures['count'], 'episode')}"
        ]
        if self.early:
            lines.append(f"{self.early}; to train on: --resume --set learner.patience=0")
        if figures["window"]:
            rates = ", ".join(f"{name} {figures[name]:.1%}" for name in OUTCOMES)
            lines.append(f"last {counted(figures['window'], 'episode')}: {rates}")
        lines.append(f"checkpoint: {self.checkpoint or 'none'}")
        if self.checkpoint:
            lines.append(f"next: lndrl evaluate {self.folder} --episodes 200")
        return "\n".join(lines)
