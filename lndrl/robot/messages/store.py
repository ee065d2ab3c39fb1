"""ROS 2 messages as bytes (CDR) and back, for the distributions that robots run.

The types and their bytes are those of rosbags; SPENCER's are described in
``spencer_tracking_msgs.yaml``.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from lndrl.errors import UserError
from lndrl.robot.messages.builders import BUILDERS
from lndrl.robot.messages.content import Content
from lndrl.robot.messages.readers import READERS

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

DISTRIBUTIONS = ("humble", "jazzy", "kilted")
NO_HASH = "TypeHashNotSupported"
"""What Humble writes where later ones write a type's hash."""
SPENCER_FILE = Path(__file__).with_name("spencer_tracking_msgs.yaml")
_MOST_ITEMS = 2**26
"""Of a sequence: a map of 400 m by 400 m at 5 cm; more is a message that lies about its length."""


class BadMessageError(Exception):
    """A message that cannot be read, or says what cannot be; its text is a sentence's middle."""


def missing_extra(package: str) -> UserError:
    """What to say where ``package`` is not installed."""
    return UserError(
        f"{package} is not installed, which speaking to robots needs; install the extra: "
        'pip install "lndrl[robot]" (in a clone pip install ".[robot]")'
    )


class MessageStore:
    """The types of one distribution.

    Raises UserError for a distribution that is not known, or without the extra ``robot``.
    """

    def __init__(self, distribution: str = "jazzy") -> None:
        if distribution not in DISTRIBUTIONS:
            raise UserError(
                f"distribution {distribution} is unknown; known: {', '.join(DISTRIBUTIONS)}"
            )
        self.distribution = distribution
        self._types = _typestore(distribution)

    def type_hash(self, name: str) -> str:
        """What stands for the definition of the type ``name`` (sensor_msgs/msg/LaserScan)."""
        return NO_HASH if self.distribution == "humble" else _hash(self.distribution, name)

    def definition(self, name: str) -> str:
        """The definition of ``name`` and of all that it is made of, as recordings carry it."""
        return self._types.generate_msgdef(name, ros_version=2)[0]

    def encode(self, name: str, content: Content) -> bytes:
        """``content`` as a message of the type ``name``, in CDR with its four-byte header."""
        message = BUILDERS[name](self._types.types, content)
        return bytes(self._types.serialize_cdr(message, name))

    def decode(self, name: str, data: bytes) -> Content:
        """What a message of the type ``name`` says; raises BadMessageError."""
        try:
            message: Any = self._types.deserialize_cdr(data, name)
            return READERS[name](message)
        except Exception:  # rosbags raises whatever its generated code meets
            raise BadMessageError(f"{len(data)} bytes that are no {name}") from None


@cache
def _hash(distribution: str, name: str) -> str:
    return str(_typestore(distribution).hash_rihs01(name))


@cache
def _typestore(distribution: str) -> Typestore:
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise missing_extra("rosbags") from None
    store = get_typestore(Stores[f"ROS2_{distribution.upper()}"])
    store.max_sequence_length = _MOST_ITEMS
    described: dict[str, list[str]] = yaml.safe_load(SPENCER_FILE.read_text("utf-8"))
    for name, lines in described.items():
        store.register(get_types_from_msg("\n".join(lines), name))
    return store
