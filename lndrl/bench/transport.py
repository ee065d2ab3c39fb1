"""``lndrl bench transport``: acknowledged uploads of real chunks over zenoh on loopback."""

from __future__ import annotations

import multiprocessing
import os
import socket
import statistics
import tempfile
import threading
from pathlib import Path
from time import perf_counter
from typing import Any

from numpy.typing import NDArray

from lndrl.bench.report import REPETITIONS
from lndrl.bench.scene import hybrid_config
from lndrl.chaos.monitor import cpu_seconds
from lndrl.errors import UserError
from lndrl.transport import (
    Ack,
    ChunkHeader,
    Hello,
    Refusal,
    Security,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
)
from lndrl.transport.security.certificates import create

_WARM_UP_CHUNKS = 5
_PATIENCE = 600.0
"""Seconds for the actor's process to start, compile and play its chunk; a fresh checkout compiles
every kernel."""


class _Receiver:
    """Learner handlers that take every chunk and note when it came and how large it was."""

    def __init__(self, config: dict[str, Any], needed_seconds: float) -> None:
        self.arrivals: list[tuple[float, int]] = []
        self.full = threading.Event()
        self.pids = [os.getpid()]
        self.spent: list[tuple[float, int]] = []  # CPU s of both sides and chunks, twice
        self._welcome = Welcome(run_id="bench", config=config, actor_index=0)
        self._needed = needed_seconds

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return self._welcome

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, NDArray[Any]], size: int) -> Ack:
        self.arrivals.append((perf_counter(), size))
        if len(self.arrivals) == _WARM_UP_CHUNKS:
            self._look_at_cpu()
        elif len(self.arrivals) > _WARM_UP_CHUNKS and not self.full.is_set():
            started = self.arrivals[_WARM_UP_CHUNKS - 1][0]
            if self.arrivals[-1][0] - started >= self._needed:
                self._look_at_cpu()
                self.full.set()
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        """All uploads can be read."""

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        return

    def cpu_per_megabyte(self) -> float:
        """CPU ms of both processes per 10^6 bytes, over the timed chunks."""
        (before, first), (after, last) = self.spent
        return 1e9 * (after - before) / sum(size for _, size in self.arrivals[first:last])

    def _look_at_cpu(self) -> None:
        spent = sum(cpu_seconds(pid) or 0.0 for pid in self.pids)
        self.spent.append((spent, len(self.arrivals)))


def measure(seconds: float) -> dict[str, Any]:
    """``chunks_per_second`` and ``megabytes_per_second`` (10^6 bytes) from one actor process.

    A chunk is what an actor sends under ``configs/lndrl.yaml``: horizon x worlds steps of the
    hybrid scenario, packed, sent, unpacked and acknowledged. Medians over equal parts of the
    time. ``cpu_milliseconds_per_megabyte`` is of both processes together. ``tls``: the same over
    mutual TLS. Raises UserError when the actor's process dies or stays silent.
    """
    plain = _measure(seconds, None)
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as folder:
        create(Path(folder), [])
        return plain | {"tls": _measure(seconds, Path(folder))}


def _measure(seconds: float, certificates: Path | None) -> dict[str, Any]:
    """The figures over plain TCP, or over TLS with the certificates in a folder."""
    config = hybrid_config()
    endpoint, security = free_endpoint(), None
    if certificates is not None:
        endpoint = endpoint.replace("tcp/", "tls/")
        security = Security("learner", certificates)
    transport = config.transport.model_copy(update={"endpoint": endpoint})
    receiver = _Receiver(config.model_dump(mode="json"), seconds)
    learner = open_learner(transport, "bench", security)
    process = multiprocessing.get_context("spawn").Process(
        target=_act, args=(endpoint, certificates), daemon=True
    )
    try:
        learner.start(receiver)
        process.start()
        assert process.pid is not None
        receiver.pids.append(process.pid)
        deadline = perf_counter() + _PATIENCE + seconds
        while not receiver.full.wait(0.1):
            if not process.is_alive() or perf_counter() > deadline:
                raise UserError("bench transport: the actor's process died or stayed silent")
        learner.finish()
        process.join(10.0)
    finally:
        process.kill()
        learner.close()
    figures = _figures(receiver.arrivals, config.actor.horizon * config.worlds_per_actor())
    return figures | {"cpu_milliseconds_per_megabyte": receiver.cpu_per_megabyte()}


def _figures(arrivals: list[tuple[float, int]], steps_per_chunk: int) -> dict[str, Any]:
    began = arrivals[_WARM_UP_CHUNKS - 1][0]
    timed = arrivals[_WARM_UP_CHUNKS:]
    part = max(1, len(timed) // REPETITIONS)
    chunk_rates, byte_rates = [], []
    for first in range(0, len(timed) - part + 1, part):
        chunks = timed[first : first + part]
        elapsed = chunks[-1][0] - began
        began = chunks[-1][0]
        chunk_rates.append(len(chunks) / elapsed)
        byte_rates.append(sum(size for _, size in chunks) / elapsed / 1e6)
    return {
        "chunks_per_second": statistics.median(chunk_rates),
        "megabytes_per_second": statistics.median(byte_rates),
        "chunk_kilobytes": statistics.median(size for _, size in timed) / 1e3,
        "steps_per_chunk": steps_per_chunk,
    }


def _act(endpoint: str, certificates: Path | None) -> None:
    """The actor's process: plays one chunk, then sends it again and again until told to stop."""
    from actors.rollout import Rollout
    from lndrl.machine.threads import set_threads
    from lndrl.policy import initial_weights

    set_threads(1)
    config = hybrid_config()
    rollout = Rollout(config, 0)
    rollout.load(0, initial_weights(config))
    chunk = rollout.collect(0)
    assert chunk is not None  # only a stopped rollout has none
    trajectory = chunk.trajectory
    episodes = [episode.to_dict() for episode in chunk.episodes]
    steps, worlds = trajectory.action.shape
    security = None if certificates is None else Security("actor", certificates)
    actor = open_actor(endpoint, security=security)
    try:
        host = socket.gethostname()
        actor.hello(Hello("bench", "bench", host, os.getpid(), worlds, "bench"), _PATIENCE)
        sequence = 0
        while not actor.done():
            sequence += 1
            header = ChunkHeader("bench", "bench", "bench", sequence, steps, worlds, episodes)
            actor.upload(header, trajectory.to_arrays())
            actor.acks()
    finally:
        actor.close()
