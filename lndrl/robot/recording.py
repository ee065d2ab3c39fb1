"""What a robot said and was told, as an MCAP file that Foxglove and ``ros2 bag`` read."""

from __future__ import annotations

import threading
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any

from lndrl.errors import UserError
from lndrl.robot.link import Quality, Topic
from lndrl.robot.messages import MessageStore, missing_extra
from lndrl.version import VERSION

_CLOSES_WITHIN = 8.0
"""s that a disk has at the end."""


class Recorder:
    """Writes messages to ``path`` from a thread of its own, so that nobody waits for a disk.

    A context manager. Raises UserError where ``path`` exists, cannot be written, or does not end
    in .mcap. What goes wrong later is in ``failed``, in words; the drive goes on.
    """

    def __init__(self, path: Path, store: MessageStore) -> None:
        if path.suffix != ".mcap":
            raise UserError(f"--record {path}: must end in .mcap")
        try:
            from mcap.writer import Writer
        except ImportError:
            raise missing_extra("mcap") from None
        try:
            self._file: IO[bytes] = path.open("xb")
        except FileExistsError:
            raise UserError(f"--record {path}: exists already; name another file") from None
        except OSError as error:
            raise UserError(f"--record {path}: cannot be written ({error.strerror})") from None
        self.failed = ""
        self.messages = 0
        self._store = store
        self._writer: Any = Writer(self._file)
        self._writer.start(profile="ros2", library=f"lndrl {VERSION}")
        self._channels: dict[Topic, int] = {}
        self._queue: SimpleQueue[tuple[Topic, bytes, int] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="lndrl-record", daemon=True)
        self._thread.start()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, topic: Topic, data: bytes, stamp: int) -> None:
        """Record a message that came or went at ``stamp`` (ns since 1970)."""
        if not self.failed:
            self._queue.put((topic, data, stamp))

    def close(self) -> None:
        """Write what is left, and the file's end, as far as the disk takes it within seconds."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join(_CLOSES_WITHIN)
            if self._thread.is_alive():
                self.failed = (
                    f"recording ended early: the disk did not take it within {_CLOSES_WITHIN:g} s"
                )

    def _work(self) -> None:
        try:
            while (item := self._queue.get()) is not None:
                self._add(*item)
            self._writer.finish()
            self._file.close()
        except Exception as error:  # whatever it is, the drive goes on
            self.failed = f"recording ended early: {getattr(error, 'strerror', None) or error}"

    def _add(self, topic: Topic, data: bytes, stamp: int) -> None:
        if topic not in self._channels:
            schema = self._writer.register_schema(
                name=topic.type,
                encoding="ros2msg",
                data=self._store.definition(topic.type).encode(),
            )
            self._channels[topic] = self._writer.register_channel(
                topic=topic.name,
                message_encoding="cdr",
                schema_id=schema,
                metadata={"offered_qos_profiles": quality_yaml(topic.quality)},
            )
        self._writer.add_message(
            channel_id=self._channels[topic], log_time=stamp, publish_time=stamp, data=data
        )
        self.messages += 1


def quality_yaml(quality: Quality) -> str:
    """A quality of service as ``ros2 bag`` writes it, in YAML."""
    forever = "{sec: 9223372036, nsec: 854775807}"
    return (
        f"- {{history: keep_last, depth: {quality.depth}, "
        f"reliability: {'reliable' if quality.reliable else 'best_effort'}, "
        f"durability: {'transient_local' if quality.transient_local else 'volatile'}, "
        f"deadline: {forever}, lifespan: {forever}, liveliness: automatic, "
        f"liveliness_lease_duration: {forever}, avoid_ros_namespace_conventions: false}}"
    )
