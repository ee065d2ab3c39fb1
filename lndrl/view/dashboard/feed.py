"""News from the learner, fetched by a thread so that drawing never waits for the network."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from lndrl.errors import UserError
from lndrl.transport.frames import Watching
from lndrl.transport.status import HistoryRow, Status, parse_history, parse_reply

ASK_EVERY = 0.5
"""s between questions to the learner."""
PATIENCE = 3.0
"""s until a question counts as unanswered."""
REOPEN_AFTER = 5
"""Unanswered questions in a row until the connection is opened anew."""


class Viewer(Protocol):
    """The viewer side of the transport."""

    def status(self, timeout: float) -> dict[str, Any]:
        """``{"snapshot": ..., "history": [...]}``; raises where no learner answers."""
        ...

    def request(self, action: str, run_id: str, timeout: float = PATIENCE) -> str:
        """What comes of asking for ``action``, in words; raises UserError with why nothing."""
        ...

    def watch(self, actor_id: str) -> Watching:
        """Have an actor show a world; raises UserError where no learner can be reached."""
        ...

    def close(self) -> None:
        """End the connection."""
        ...


@dataclass(frozen=True)
class News:
    """One answer of the learner."""

    status: Status
    history: list[HistoryRow]
    raw: dict[str, Any]
    heard: float = field(default_factory=time.monotonic)
    """Monotonic s when the learner last wrote something new."""

    @property
    def age(self) -> float:
        """s since the learner last wrote something new."""
        return max(time.monotonic() - self.heard, 0.0)


def ask(viewer: Viewer, timeout: float = PATIENCE) -> News:
    """One question; raises UserError or the transport's own error."""
    return news_of(viewer.status(timeout))


def news_of(reply: dict[str, Any]) -> News:
    """News from ``{"snapshot": ..., "history": [...]}``; raises UserError for anything else."""
    return News(*parse_reply(reply), reply)


class Feed:
    """The newest News, renewed in the background until closed.

    Asks instead of listening, so that a learner that comes back, under the same address or with
    a new history, is simply the next answer. An answer that repeats an old snapshot (the learner
    hangs while its network still answers) does not count as news.
    """

    def __init__(
        self, open_viewer: Callable[[], Viewer], viewer: Viewer | None, first: News
    ) -> None:
        self._open = open_viewer
        self._viewer = viewer
        self._newest = first
        self._closed = threading.Event()
        self._rows: dict[tuple[Any, Any], HistoryRow] = {}
        self._thread = threading.Thread(target=self._run, name="dashboard-feed", daemon=True)
        self._thread.start()

    @property
    def newest(self) -> News:
        """The last answer that held something new."""
        return self._newest

    def request(self, action: str) -> str:
        """What comes of asking the learner for ``action``, in words; takes up to PATIENCE s."""
        viewer = self._viewer
        if viewer is None:
            return "nothing can be asked: there is no connection"
        try:
            return viewer.request(action, self._newest.status.run_id, PATIENCE)
        except UserError as error:
            return str(error)
        except Exception as error:  # of a connection that is lost meanwhile
            return f"nobody answered ({type(error).__name__})"

    def watch(self, actor_id: str) -> Watching:
        """Have an actor show a world; raises UserError where there is no connection."""
        viewer = self._viewer
        if viewer is None:
            raise UserError("there is no connection")
        return viewer.watch(actor_id)

    def close(self) -> None:
        """Stop asking and end the connection; does not wait for an answer that is due."""
        self._closed.set()
        self._thread.join(timeout=0.5)

    def _run(self) -> None:
        failures = 0
        while not self._closed.wait(ASK_EVERY):
            try:
                if self._viewer is None:
                    self._viewer = self._open()
                self._take(self._viewer.status(PATIENCE))
                failures = 0
            except Exception:  # whatever happens to a connection, a viewer keeps trying
                failures += 1
                if failures % REOPEN_AFTER == 0:
                    self._drop()
        self._drop()

    def _take(self, reply: dict[str, Any]) -> None:
        old, told = self._newest.raw["snapshot"], reply.get("snapshot")
        if isinstance(told, dict) and all(told.get(k) == old.get(k) for k in ("time", "run_id")):
            return
        status, _ = parse_reply({**reply, "history": []})
        self._newest = News(status, self._history(reply.get("history") or []), reply)

    def _history(self, rows: Any) -> list[HistoryRow]:
        """What ``parse_history`` makes of ``rows``, but those that are known from before.

        A row never changes, and hundreds of them come with every answer.
        """
        known, parsed = self._rows, []
        for row in rows:
            key = (row.get("time"), row.get("steps")) if isinstance(row, dict) else (None, None)
            parsed.append(known.get(key) or parse_history([row])[0])
        keys = ((row.get("time"), row.get("steps")) for row in rows)
        self._rows = dict(zip(keys, parsed, strict=True))
        return parsed

    def _drop(self) -> None:
        viewer, self._viewer = self._viewer, None
        if viewer is not None:
            try:
                viewer.close()
            except Exception:  # the connection is lost anyway
                return


def plain_json(value: Any) -> Any:
    """``value`` with NaN and infinities as None, which strict JSON demands."""
    if isinstance(value, dict):
        return {str(key): plain_json(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def first_news(viewer: Viewer, where: str, timeout: float = PATIENCE) -> News:
    """The first answer; raises UserError that names ``where`` when nobody answers."""
    try:
        return ask(viewer, timeout)
    except UserError:
        raise
    except Exception as error:
        raise UserError(
            f"no learner answers at {where} ({type(error).__name__}); "
            "start one with: lndrl learner CONFIG"
        ) from error
