"""A bag of ROS 2 (MCAP or SQLite, a file or a folder) as messages by what they are for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lndrl.errors import UserError
from lndrl.robot.messages import BadMessageError, Content, MessageStore, missing_extra, names
from lndrl.robot.topics import Topics

PURPOSES = (
    "tf_static", "tf", "odometry", "map", "people", "people_poses", "robot_pose", "initial_pose",
    "goal", "clock", "command", "own_pose", "scan",
)  # fmt: skip
_NEEDED = ("scan", "odometry")
_POSES = (names.POSE_COVARIANCE, names.POSE, names.ODOMETRY)
"""Types that a reference may have."""


@dataclass(frozen=True)
class Recorded:
    """A message that was recorded at ``stamp`` (ns). ``words`` says why there is no content."""

    purpose: str
    topic: str
    stamp: int
    content: Content | None
    words: str = ""


class Bag:
    """The recording at ``path``. ``reference`` is a topic of poses to compare with, under the
    purpose ``reference``.

    Raises UserError for what is no bag, has no scan or odometry, or another type under a name.
    """

    def __init__(self, path: Path, topics: Topics, reference: str | None = None) -> None:
        try:
            from rosbags.rosbag2 import Reader
        except ImportError:
            raise missing_extra("rosbags") from None
        self.path = path
        self._store = MessageStore()
        self._wanted = {getattr(topics, purpose): purpose for purpose in PURPOSES}
        self._reference = reference
        try:
            self._reader: Any = Reader(path)
            self._reader.open()
        except Exception as error:  # rosbags raises whatever its formats meet
            said = " ".join(str(error).split())[:200]
            raise UserError(f"{path}: is no bag of ROS 2 that can be read ({said})") from None
        try:
            self.types = {each.topic: each.msgtype for each in self._reader.connections}
            self._check(topics)
        except BaseException:
            self._reader.close()
            raise

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._reader.close()

    @property
    def seconds(self) -> float:
        """From the first to the last message."""
        return float(self._reader.duration) / 1e9

    @property
    def simulated(self) -> bool:
        """Whether time in it is a simulation's."""
        return "clock" in {self._wanted.get(topic) for topic in self.types}

    def name_of(self, purpose: str) -> str:
        """The topic that is for ``purpose``."""
        if purpose == "reference":
            return self._reference or ""
        return next(topic for topic, each in self._wanted.items() if each == purpose)

    def messages(self) -> Iterator[Recorded]:
        """All that has a purpose, in the order of recording. Raises UserError where the file ends
        in the middle.
        """
        chosen = [
            each
            for each in self._reader.connections
            if each.topic in self._wanted or each.topic == self._reference
        ]
        try:
            for connection, stamp, data in self._reader.messages(connections=chosen):
                yield from self._read(connection.topic, connection.msgtype, stamp, bytes(data))
        except UserError:
            raise
        except Exception as error:
            said = " ".join(str(error).split())[:200]
            raise UserError(f"{self.path}: cannot be read to its end ({said})") from None

    def _read(self, topic: str, type_: str, stamp: int, data: bytes) -> Iterator[Recorded]:
        words, content = "", None
        try:
            content = self._store.decode(type_, data)
        except BadMessageError as error:
            words = f"{topic} carries {error}"
        if topic in self._wanted:
            yield Recorded(self._wanted[topic], topic, stamp, content, words)
        if topic == self._reference:
            yield Recorded("reference", topic, stamp, content, words)

    def _check(self, topics: Topics) -> None:
        there = ", ".join(f"{topic} ({type_})" for topic, type_ in sorted(self.types.items()))
        for purpose in _NEEDED:
            if (name := getattr(topics, purpose)) not in self.types:
                raise UserError(
                    f"{self.path}: has no {name}; say --topic {purpose}=/NAME. It has "
                    f"{there or 'nothing'}"
                )
        for topic, purpose in self._wanted.items():
            expected = {topics.topic(purpose).type}
            if purpose == "command":
                expected = {names.TWIST, names.TWIST_STAMPED}
            if topic in self.types and self.types[topic] not in expected:
                raise UserError(
                    f"{self.path}: {topic} has the type {self.types[topic]}, not "
                    f"{' or '.join(sorted(expected))}; say --topic {purpose}=/NAME"
                )
        if self._reference is not None and self.types.get(self._reference) not in _POSES:
            raise UserError(
                f"{self.path}: --reference {self._reference} must be a topic of "
                f"{', '.join(_POSES)}; it has {there}"
            )
