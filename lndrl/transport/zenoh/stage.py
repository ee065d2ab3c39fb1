"""Worlds that are shown over Zenoh: an actor's stage, a viewer's seat, and a site's window.

Whoever watches subscribes to the actor's key. Zenoh tells the actor's publisher whether there is
such a subscriber; nothing is put, and so nothing is sent, while there is none.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import zenoh
from numpy.typing import NDArray

from lndrl.errors import UserError
from lndrl.transport.frames import WorldFrame, decode_frame
from lndrl.transport.keys import world_key
from lndrl.transport.messages import MessageError

logger = logging.getLogger(__name__)


class Stage:
    """Where an actor shows a world, within one session."""

    def __init__(
        self,
        session: zenoh.Session,
        actor_id: str,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.watched = False
        self._on_change = on_change
        # Frames go behind all else on the link, and are dropped where it is full.
        self._publisher = session.declare_publisher(
            world_key(actor_id),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.BACKGROUND,
        )
        self._listener = self._publisher.declare_matching_listener(self._on_match)
        present: Any = self._publisher.matching_status  # zenoh's stub calls it a bool
        self.watched = present.matching

    def _on_match(self, status: zenoh.MatchingStatus) -> None:
        self.watched = status.matching
        self._on_change()

    def close(self) -> None:
        """Show nothing any more."""
        with suppress(zenoh.ZError):
            self._publisher.undeclare()

    def show(self, frame: bytes | zenoh.ZBytes) -> None:
        """Send a frame to whoever watches; what cannot leave is lost."""
        try:
            self._publisher.put(frame)
        except zenoh.ZError as error:  # the session is being closed
            logger.debug("a frame could not leave: %s", error)


class Seat:
    """See ``frames.Watching``: the newest frame alone is kept."""

    def __init__(self, session: zenoh.Session, actor_id: str) -> None:
        self._subscriber = session.declare_subscriber(
            world_key(actor_id), zenoh.handlers.RingChannel(1)
        )

    def newest(self) -> tuple[WorldFrame, dict[str, NDArray[Any]]] | None:
        """The newest frame since the last call."""
        try:
            sample = self._subscriber.try_recv()
        except zenoh.ZError:  # the session has been closed
            return None
        if sample is None:
            return None
        try:
            return decode_frame(sample.payload.to_bytes())
        except MessageError as error:
            raise UserError(
                f"what this actor shows cannot be read ({error}); install the same lndrl version"
            ) from None

    def close(self) -> None:
        """Listen no longer."""
        with suppress(zenoh.ZError):
            self._subscriber.undeclare()


class Window:
    """What a site passes on of its actor's world, while somebody beyond the learner watches it.

    ``hand`` has work done on a thread that is none of zenoh's: only there may sessions be changed.
    """

    def __init__(
        self,
        down: zenoh.Session,
        up: zenoh.Session,
        actor_id: str,
        hand: Callable[[Callable[[], None]], None],
    ) -> None:
        self._down, self._key = down, world_key(actor_id)
        self._turn = threading.Lock()
        self._heard: Any = None
        self._closed = False
        self._stage = Stage(up, actor_id, lambda: hand(self._look))
        hand(self._look)

    def _look(self) -> None:
        """Listen to the actor exactly while somebody watches."""
        with self._turn:
            wanted = self._stage.watched and not self._closed
            if wanted and self._heard is None:
                self._heard = self._down.declare_subscriber(
                    self._key, lambda sample: self._stage.show(sample.payload)
                )
            elif not wanted and self._heard is not None:
                heard, self._heard = self._heard, None
                heard.undeclare()

    def close(self) -> None:
        """Pass on no more."""
        self._closed = True
        with suppress(zenoh.ZError):  # a session may be gone
            self._look()
        self._stage.close()
