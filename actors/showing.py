"""One of an actor's worlds, shown to whoever watches it, for next to nothing of the actor's time.

While nobody watches, all there is to it is one question per step. While somebody does, a frame is
made at most ten times a second, and never so often that frames take more than ``MOST_CPU`` of the
CPU time of this process.
"""

from __future__ import annotations

import logging
import time

import numpy as np
from numpy.typing import NDArray

from lndrl.navigation import Navigation
from lndrl.navigation.live import Framer
from lndrl.transport import ActorEndpoint
from lndrl.transport.frames import FRAMES_PER_SECOND
from lndrl.transport.messages import MessageError

logger = logging.getLogger(__name__)

MOST_CPU = 0.015
"""Of this process's CPU time that frames may take; zenoh's threads send them for a little more."""
_PAUSE = 1.0 / FRAMES_PER_SECOND


class Showing:
    """Shows the world that ``see`` is called with, over ``endpoint``.

    ``frames`` and ``seconds`` (of CPU time) are what it has taken so far.
    """

    def __init__(self, endpoint: ActorEndpoint, run_id: str, actor_id: str) -> None:
        self.frames = 0
        self.seconds = 0.0
        self._endpoint = endpoint
        self._framer = Framer(run_id, actor_id)
        self._sent = float("-inf")  # monotonic s
        self._rested = 0.0  # s of the process's CPU time at which the next frame may be made
        self._end: bytes | None = None  # of an episode, still to be sent

    def wanted(self) -> bool:
        """Whether ``see`` would send a frame now."""
        if not self._endpoint.watched():
            return False
        if time.monotonic() - self._sent < _PAUSE:
            return False
        return self._end is not None or time.process_time() >= self._rested

    def see(self, world: Navigation, probabilities: NDArray[np.floating], version: int) -> None:
        """Send how ``world`` stands after a step that the policy chose by ``probabilities``;
        first, where it is still to be sent, how its last episode ended.
        """
        frame, self._end = self._end, None
        if frame is None:
            frame = self._made(world, probabilities, version)
        self._sent = time.monotonic()
        if frame is not None:
            self._endpoint.show(frame)

    def ended(self, world: Navigation, version: int) -> None:
        """Keep the end of an episode: between two frames it would go unseen."""
        if self._endpoint.watched() and time.process_time() >= self._rested:
            self._end = self._made(world, np.zeros(0), version)

    def _made(
        self, world: Navigation, probabilities: NDArray[np.floating], version: int
    ) -> bytes | None:
        began = time.thread_time()
        try:
            snapshot = world.snapshot(probabilities)
            frame = self._framer.frame(snapshot, version, world.layout)
        except MessageError as error:  # whatever a world has become, its training goes on
            logger.warning("this world cannot be shown: %s", error)
            frame = None
        took = time.thread_time() - began
        self.frames += 1
        self.seconds += took
        self._rested = time.process_time() + took / MOST_CPU
        return frame
