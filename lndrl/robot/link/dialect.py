"""What two ways of carrying ROS 2 over Zenoh have in common: topics, quality, who is there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from lndrl.errors import UserError

Kind = Literal["publisher", "subscriber"]


@dataclass(frozen=True)
class Quality:
    """Quality of service, as ROS names it: what is not said here is ROS's default."""

    reliable: bool = True
    transient_local: bool = False
    """The last ``depth`` messages are kept for who comes later."""
    depth: int = 10


RELIABLE = Quality()
SENSOR = Quality(reliable=False, depth=5)
LATCHED = Quality(transient_local=True, depth=1)


@dataclass(frozen=True)
class Topic:
    """A topic's full name (/scan), its message type (sensor_msgs/msg/LaserScan) and quality."""

    name: str
    type: str
    quality: Quality = RELIABLE

    def __post_init__(self) -> None:
        chunks = self.name.split("/")
        if chunks[0] or len(chunks) < 2 or not all(_is_name(chunk) for chunk in chunks[1:]):
            raise UserError(
                f"topic {self.name!r}: must be a full name like /scan or /robot1/scan, of letters, "
                "digits and '_'"
            )


def _is_name(chunk: str) -> bool:
    return chunk.isascii() and chunk.isidentifier()


@dataclass(frozen=True)
class Endpoint:
    """A publisher or subscriber that somebody has announced."""

    kind: Kind
    topic: str
    type: str
    type_hash: str
    """Empty where the dialect does not say it."""
    session: str
    node: str


@dataclass(frozen=True)
class Party:
    """Who speaks: a session's id, and the name of its one node."""

    session: str
    node: str


class Dialect(Protocol):
    """How topics become keys, and endpoints become liveliness tokens."""

    name: str
    tokens: tuple[str, ...]
    """Key expressions of the tokens of everybody."""

    def publish_key(self, topic: Topic) -> str:
        """Where messages of ``topic`` go."""

    def subscribe_key(self, topic: Topic) -> str:
        """Where they come from, whatever distribution the other side runs."""

    def node_token(self, party: Party) -> str | None:
        """The token of the node, where nodes have one."""

    def token(self, kind: Kind, topic: Topic, party: Party, number: int) -> str:
        """The token of an endpoint, the ``number``-th of its node, from 1."""

    def read_token(self, key: str) -> Endpoint | None:
        """What a token says; None for what is no endpoint's, or not of this dialect."""

    def hash_in(self, key: str) -> str:
        """The type's hash in the key of a message; empty where it has none."""

    def attachment(self, token: str, sequence: int, stamp: int) -> bytes | None:
        """What goes with the ``sequence``-th message (from 1), sent at ``stamp`` ns, of the
        publisher with ``token``."""
