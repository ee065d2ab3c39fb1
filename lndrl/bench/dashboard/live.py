"""CPU of a real actor while somebody watches its world, beside the same actor unwatched."""

from __future__ import annotations

import statistics
import subprocess
import sys
import threading
import time
from typing import Any

import psutil
from numpy.typing import NDArray

from lndrl.config import TransportConfig, load_config
from lndrl.errors import UserError
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.processes import end
from lndrl.policy import initial_weights
from lndrl.transport import (
    Ack,
    ChunkHeader,
    Hello,
    Refusal,
    Welcome,
    free_endpoint,
    open_learner,
    open_viewer,
)
from lndrl.transport.frames import encode_frame

TURNS = 6
"""Half of them watched, in turns, so that what else the machine does meets both alike."""
PATIENCE = 300.0
"""s until the actor must have sent its first chunk, kernels compiled."""
LEAST_CHUNKS = 3
"""That each turn must have, besides the one in which it begins."""


class _Learner:
    """Takes every chunk, and notes the actor's CPU time between two of them.

    So much stands for one number of steps exactly, whatever a clock says. ``chunks`` are pairs:
    whether somebody watched throughout, and CPU seconds.
    """

    def __init__(self) -> None:
        self.config = load_config(DEFAULT_CONFIG)
        self.actor_id = ""
        self.chunks: list[tuple[bool, float]] = []
        self.watching = False
        self.arrived = threading.Event()
        self._process: psutil.Process | None = None
        self._last: tuple[bool, float] | None = None

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        self.actor_id, self._process = hello.actor_id, psutil.Process(hello.pid)
        return Welcome("bench", self.config.model_dump(mode="json"), 0)

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, NDArray[Any]], size: int) -> Ack:
        assert self._process is not None
        now = self.watching, sum(self._process.cpu_times()[:2])
        if self._last is not None and self._last[0] == now[0]:
            self.chunks.append((now[0], now[1] - self._last[1]))
        self._last = now
        self.arrived.set()
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        raise UserError(f"bench dashboard: a chunk cannot be read ({reason})")

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        pass

    def spent(self, watched: bool) -> list[float]:
        """CPU seconds of the chunks, by whether somebody watched."""
        return [seconds for seen, seconds in self.chunks if seen == watched]


def measure(seconds: float) -> dict[str, float]:
    """``actor_cpu``: CPU time per chunk of one actor that is watched, as a multiple of that of the
    same actor unwatched, medians over TURNS of ``seconds`` and LEAST_CHUNKS chunks at least.

    And ``frames_per_second`` that arrive, ``frame_kilobytes`` of the largest. Raises UserError when
    no actor comes to work.
    """
    learner = _Learner()
    endpoint = free_endpoint()
    door = open_learner(TransportConfig(endpoint=endpoint), "bench")
    viewer = open_viewer(endpoint)
    command = [sys.executable, "-m", "lndrl", "actor", "--connect", endpoint, "--count", "1"]
    actor = subprocess.Popen(
        command, env=this_program(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        door.start(learner)
        door.publish_weights(1, initial_weights(learner.config))
        if not learner.arrived.wait(PATIENCE):
            raise UserError(f"bench dashboard: no actor was at work within {PATIENCE:g} s")
        frames, largest, watched = 0, 0, 0.0
        for turn in range(TURNS):
            if turn % 2 == 0:
                _wait(learner, seconds)
                continue
            found, size, took = _watch(learner, viewer, seconds)
            frames, largest, watched = frames + found, max(largest, size), watched + took
        with_it, without = (statistics.median(learner.spent(each)) for each in (True, False))
        return {
            "actor_cpu": with_it / without,
            "frames_per_second": frames / watched,
            "frame_kilobytes": largest / 1000.0,
        }
    finally:
        end(actor)
        viewer.close()
        door.close()


def _wait(learner: _Learner, seconds: float) -> None:
    """Until so much time has gone and enough chunks have come."""
    until, least = time.monotonic() + seconds, len(learner.chunks) + LEAST_CHUNKS
    while time.monotonic() < until or len(learner.chunks) < least:
        if time.monotonic() > until + PATIENCE:
            raise UserError("bench dashboard: the actor has stopped working")
        time.sleep(0.05)


def _watch(learner: _Learner, viewer: Any, seconds: float) -> tuple[int, int, float]:
    """Watch for a turn: frames that came, bytes of the largest, s."""
    seat = viewer.watch(learner.actor_id)
    learner.watching = True
    began, frames, largest = time.monotonic(), 0, 0
    waiting = threading.Thread(target=_wait, args=(learner, seconds))
    waiting.start()
    try:
        while waiting.is_alive():
            if (found := seat.newest()) is not None:
                frames, largest = frames + 1, max(largest, len(encode_frame(*found)))
            time.sleep(0.02)
    finally:
        learner.watching = False
        seat.close()
        waiting.join()
    return frames, largest, time.monotonic() - began
