"""Endpoints of either kind, what answers them, and what is sent, for the tests of this folder."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from lndrl.config import TransportConfig
from lndrl.transport import (
    Ack,
    ChunkHeader,
    Hello,
    MemoryNetwork,
    Refusal,
    Welcome,
    free_endpoint,
    open_actor,
    open_learner,
    open_viewer,
)

PATIENCE = 60.0  # s, for machines with much else to do
HELLO = Hello("actor-0", "first", "here", 1, 8, "0.1")


class RecordingHandlers:
    """Welcomes everybody but ``banned``; keeps what arrives; acks by ``answer``."""

    def __init__(self) -> None:
        self.hellos: list[Hello] = []
        self.chunks: list[tuple[ChunkHeader, dict, int]] = []
        self.members: list[tuple[str, str, bool]] = []
        self.answer: Callable[[ChunkHeader], Ack] = lambda header: Ack("accepted")

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        self.hellos.append(hello)
        if hello.actor_id == "banned":
            return Refusal("banned actors may not join")
        return Welcome("run-1", {"seed": 7, "nested": {"a": [1, 2]}}, len(self.hellos) - 1)

    def on_chunk(self, header: ChunkHeader, arrays: dict, size: int) -> Ack:
        self.chunks.append((header, arrays, size))
        return self.answer(header)

    def on_malformed(self, reason: str) -> None:
        pass

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        self.members.append((actor_id, incarnation, alive))

    def sequences(self) -> list[int]:
        return [header.sequence for header, _, _ in self.chunks]


class Setup:
    """Makes endpoints of one kind and closes them all."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.config = TransportConfig(
            endpoint=free_endpoint(), upload_timeout=20.0, upload_window=2, lease=10.0
        )
        self.network = MemoryNetwork(self.config)
        self.open: list = []

    def learner(self, handlers: RecordingHandlers):
        memory = self.kind == "memory"
        endpoint = self.network.learner("run-1") if memory else open_learner(self.config, "run-1")
        self.open.append(endpoint)
        endpoint.start(handlers)
        return endpoint

    def actor(self):
        memory = self.kind == "memory"
        self.open.append(
            self.network.actor() if memory else open_actor(self.config.endpoint, self.config)
        )
        return self.open[-1]

    def viewer(self):
        memory = self.kind == "memory"
        self.open.append(self.network.viewer() if memory else open_viewer(self.config.endpoint))
        return self.open[-1]


def chunk(sequence: int, fill: int = 0) -> tuple[ChunkHeader, dict]:
    header = ChunkHeader("run-1", "actor-0", "first", sequence, 64, 8, [{"outcome": "lost"}])
    return header, {"scan": np.full((4, 720), fill, np.uint16), "reward": np.ones(4, np.float32)}


def eventually(condition: Callable[[], bool], seconds: float = PATIENCE) -> bool:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True
