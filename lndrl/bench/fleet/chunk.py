"""A chunk that a real actor has collected, written once and sent under any number."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.transport import ChunkHeader, Hello
from lndrl.transport.messages import encode

_NO_SEQUENCE = 2**31 - 1
_KEY = b"sequence\xce"  # msgpack's uint32, four bytes whatever the number
_NO_VERSION = 0xA5C3A5C3


class Template:
    """A chunk of one actor as bytes, in which sequence and version can be changed in place."""

    def __init__(self, run_id: str, hello: Hello, arrays: dict[str, NDArray[np.generic]]) -> None:
        steps, worlds = arrays["action"].shape
        spent = {"simulate": 0.08, "infer": 0.02, "upload": 0.001, "wait": 0.002, "other": 0.002}
        header = ChunkHeader(
            *(run_id, hello.actor_id, hello.incarnation, _NO_SEQUENCE, steps, worlds),
            timing=spent,
            host=hello.host,
            pid=hello.pid,
        )
        version = np.full((steps, worlds), _NO_VERSION, np.uint32)
        self._bytes = bytearray(encode(header, {**arrays, "version": version}))
        self._sequence = self._bytes.index(_KEY) + len(_KEY)
        begin = self._bytes.index(version.tobytes())
        self._version = slice(begin, begin + version.nbytes)
        self.samples = version.size

    def hold(self, version: int) -> None:
        """From now on the policy that acts is of weights ``version``."""
        count = (self._version.stop - self._version.start) // 4
        self._bytes[self._version] = version.to_bytes(4, "little") * count

    def chunk(self, sequence: int) -> bytes:
        """The upload of that number."""
        self._bytes[self._sequence : self._sequence + 4] = sequence.to_bytes(4, "big")
        return bytes(self._bytes)


def collect(config: RunConfig, worlds: int) -> dict[str, Any]:
    """A chunk of ``worlds`` worlds under first weights, as an actor collects it."""
    from actors.rollout import Rollout
    from lndrl.machine.threads import set_threads
    from lndrl.policy import initial_weights

    set_threads(1)
    rollout = Rollout(config, 0, worlds)
    rollout.load(0, initial_weights(config))
    chunk = rollout.collect(0)
    assert chunk is not None  # only a stopped rollout has none
    return dict(chunk.trajectory.to_arrays())


def main() -> None:
    """Collect a chunk: folder, worlds and settings (key=value) stand in the command line."""
    from lndrl.bench.fleet.scene import fleet_config

    file, worlds, *settings = sys.argv[1:]
    arrays: dict[str, Any] = collect(fleet_config(settings), int(worlds))
    np.savez(Path(file), **arrays)


if __name__ == "__main__":  # in a process of its own, which gives its memory back
    main()
