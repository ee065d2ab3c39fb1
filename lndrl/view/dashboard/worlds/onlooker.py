"""Watching one actor's world: its frames as they come, and what to say while none does."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.navigation import WorldSnapshot
from lndrl.navigation.live import grid_of, snapshot_of
from lndrl.transport.frames import Watching
from lndrl.transport.messages import MessageError
from lndrl.view.text import printable

SILENT_AFTER = 5.0
"""s without a frame after which that is said, and listening begins anew."""
HOLD_END = 1.2
"""s that the end of an episode stays, so that it can be seen."""
Watch = Callable[[str], Watching]


class Onlooker:
    """Has ``actor_id`` show a world from now until ``close``; opened by a thread, as that asks the
    network.

    ``snapshot`` is what is to be drawn, None before the first frame with a grid; ``version`` of the
    weights it acts on; ``ends`` counts how episodes have ended meanwhile.
    """

    def __init__(self, actor_id: str, watch: Watch) -> None:
        self.actor_id = actor_id
        self.snapshot: WorldSnapshot | None = None
        self.version = -1
        self.ends: Counter[str] = Counter()
        self._watch = watch
        self._seat: Watching | None = None
        self._closed = False
        self._opening = threading.Lock()
        self._problem = ""
        self._grid: tuple[int, NDArray[np.bool_]] | None = None
        self._heard = time.monotonic()
        self._held_until = 0.0
        self._last_end = (-1, -1)
        self._begin()

    def look(self) -> bool:
        """Take in what has come; whether there is something else to draw."""
        seat, now = self._seat, time.monotonic()
        try:
            found = seat.newest() if seat is not None else None
            if found is not None:
                frame, arrays = found
                self._heard, self._problem = now, ""
                if (grid := grid_of(frame, arrays)) is not None:
                    self._grid = frame.grid_id, grid
                known = self._grid is not None and self._grid[0] == frame.grid_id
                if known and (frame.outcome or now >= self._held_until):
                    assert self._grid is not None
                    self.snapshot = snapshot_of(frame, arrays, self._grid[1])
                    self.version = frame.weights_version
                    self._note_end(self.snapshot, now)
                    return True
        except (UserError, MessageError) as error:
            self._problem, self._heard = str(error), now
        if now - self._heard >= SILENT_AFTER:
            self._heard = now
            self._problem = (
                self._problem
                or "nothing comes: it waits for the learner, is of an "
                "older version, or this role may not look"
            )
            self._begin()
        return False

    def words(self) -> str:
        """What is wrong, or being waited for; nothing where all is well."""
        if self._problem:
            return printable(self._problem)
        return "" if self.snapshot is not None else "waiting for its first picture …"

    def close(self) -> None:
        """Watch no longer."""
        self._closed = True
        threading.Thread(target=self._leave, name="dashboard-world", daemon=True).start()

    def _note_end(self, snapshot: WorldSnapshot, now: float) -> None:
        place = snapshot.world, snapshot.episode
        if snapshot.outcome and place != self._last_end:
            self._last_end, self._held_until = place, now + HOLD_END
            self.ends[snapshot.outcome] += 1

    def _begin(self) -> None:
        threading.Thread(target=self._open, name="dashboard-world", daemon=True).start()

    def _open(self) -> None:
        with self._opening:
            former, self._seat = self._seat, None
            try:
                if former is not None:
                    former.close()
                if not self._closed:
                    self._seat = self._watch(self.actor_id)
            except Exception as error:  # whatever happens to a connection, a viewer keeps trying
                self._problem = str(error)
        if self._closed:
            self._leave()

    def _leave(self) -> None:
        with self._opening:
            seat, self._seat = self._seat, None
            if seat is not None:
                seat.close()
