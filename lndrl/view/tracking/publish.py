"""Sends a run's rows to a tracker, at once or as they come; one that fails is told of once."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from typing import Any, Protocol

from lndrl.config import flatten, load_config
from lndrl.errors import UserError
from lndrl.view.tracking.feed import Feed, Row, made_at
from lndrl.wording import counted

TRACKERS = {"wandb": "wandb", "mlflow": "mlflow"}
"""Trackers by name, and the package that each needs."""
_LOOK = 2.0  # s between two looks at the file
_BATCH = 500  # rows that are sent together
_FIRST_PAUSE, _LONGEST_PAUSE = 5.0, 60.0  # s until a failed batch is tried again
_CREDENTIALS = re.compile(r"//[^/@\s]+@")


class TrackerError(Exception):
    """A tracker cannot be reached or refuses; the message is a sentence without an end."""


@dataclass(frozen=True)
class RunFacts:
    """What a tracker shows of a run beside its curves; ``config`` by dotted keys, plain values."""

    folder: Path
    name: str
    run_id: str
    version: str
    config: dict[str, Any]


class Tracker(Protocol):
    """Where rows go. Every method raises TrackerError."""

    where: str
    """In words, without credentials."""

    def sent(self) -> float:
        """Unix s at which the newest row was made that it has; 0 for none."""
        ...

    def send(self, rows: Sequence[Row]) -> None:
        """Take rows, oldest first."""
        ...

    def finish(self, ended: bool) -> None:
        """Nothing comes any more now; ``ended``: the run has all its steps."""
        ...


def facts_of(folder: Path) -> RunFacts:
    """Of a run folder; raises UserError for what is none."""
    try:
        identity = json.loads((folder / "run.json").read_text("utf-8"))
        run_id, version = str(identity["run_id"]), str(identity["version"])
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(f"{folder}: is no run folder of lndrl (it has no run.json)") from None
    config = flatten(load_config(folder / "config.yaml").model_dump(mode="json"))
    return RunFacts(folder, folder.resolve().name, run_id, version, config)


def check_tracker(name: str, option: str) -> str:
    """``name`` if it is one of TRACKERS and its package is here; raises UserError."""
    if name not in TRACKERS:
        raise UserError(f"{option} {name}: is unknown; known: {', '.join(TRACKERS)}")
    package = TRACKERS[name]
    if find_spec(package) is None:
        raise UserError(
            f"{option} {name} needs the package {package}, which is not installed here: "
            f'pip install "lndrl[{name}]" (in a clone pip install ".[{name}]")'
        )
    return name


def open_tracker(name: str, facts: RunFacts) -> Tracker:
    """The tracker ``name`` for a run. Raises TrackerError."""
    if name == "wandb":
        from lndrl.view.tracking.to_wandb import WandbTracker

        return WandbTracker(facts)
    from lndrl.view.tracking.to_mlflow import MlflowTracker

    return MlflowTracker(facts)


def publish(
    facts: RunFacts,
    open_it: Callable[[], Tracker],
    going: Callable[[], bool] | None,
    stop: Event,
    say: Callable[[str], None],
) -> int:
    """Send what there is, and with ``going`` what comes while that says so; rows that were sent.

    With ``going``, a tracker that fails is said once and tried again until it works. Raises
    TrackerError for the last failure where rows are left that it has not got.
    """
    sender = _Sender(facts, open_it, say)
    while True:
        # Asked before the file is read: what a learner has written until it left is then in it.
        over = going is None or not going() or stop.is_set()
        if sender.turn(last=over):
            if over:
                break
            stop.wait(_LOOK)
        else:
            stop.wait(sender.pause)
    sender.finish()
    return sender.count


class _Sender:
    """One turn after the other: new rows, or those again that could not be sent."""

    def __init__(
        self, facts: RunFacts, open_it: Callable[[], Tracker], say: Callable[[str], None]
    ) -> None:
        self.count, self.pause = 0, _FIRST_PAUSE
        self._facts, self._open, self._say = facts, open_it, say
        self._tracker: Tracker | None = None
        self._feed: Feed | None = None
        self._waiting: list[Row] = []
        self._failed = False

    def turn(self, last: bool) -> bool:
        """Send what waits; whether that went well. In the ``last`` one raises TrackerError."""
        try:
            if self._tracker is None:
                self._tracker = self._open()
                self._say(f"to {self._tracker.where}")
            if self._feed is None:
                path = self._facts.folder / "metrics.jsonl"
                self._feed = Feed(path, self._tracker.sent())
            self._waiting += self._feed.read()
            while self._waiting:
                batch = self._waiting[:_BATCH]
                self._tracker.send(batch)
                del self._waiting[: len(batch)]
                self.count += len(batch)
        except (TrackerError, OSError) as error:
            if last:
                raise TrackerError(plain(error)) from None
            if not self._failed:
                self._say(f"{plain(error)}; tried again until it works, training goes on")
            self._failed = True
            self.pause = min(2 * self.pause, _LONGEST_PAUSE)
            return False
        if self._failed:
            self._say(f"works again, {counted(self.count, 'row')} sent")
            self._failed, self.pause = False, _FIRST_PAUSE
        return True

    def finish(self) -> None:
        """Say goodbye."""
        if self._tracker is not None:
            self._tracker.finish(_is_finished(self._facts.folder))


def plain(error: Exception) -> str:
    """An error's words on one line, without a name and password that an address may hold."""
    words = " ".join(str(error).split())[:400] or type(error).__name__
    return _CREDENTIALS.sub("//", words).rstrip(".")


def quiet_modules(*names: str) -> None:
    """Let nothing of these packages be printed that is not ours."""
    import logging

    for name in names:
        logging.getLogger(name).setLevel(logging.ERROR)
    sys.stdout.flush()


def _is_finished(folder: Path) -> bool:
    try:
        return json.loads((folder / "summary.json").read_text("utf-8"))["finished"] is True
    except (OSError, ValueError, KeyError, TypeError):
        return False


__all__ = [
    "TRACKERS",
    "RunFacts",
    "Tracker",
    "TrackerError",
    "check_tracker",
    "facts_of",
    "made_at",
    "open_tracker",
    "plain",
    "publish",
    "quiet_modules",
]
