"""rmw_zenoh: ROS 2 nodes that speak Zenoh themselves, without DDS.

A key names domain, topic, type and the type's hash; every message has an attachment, without which
it is dropped (rmw_zenoh 0.1.9 to 0.6.7).
"""

from __future__ import annotations

import struct

from lndrl.robot.link.dialect import Endpoint, Kind, Party, Quality, Topic
from lndrl.robot.messages import MessageStore, missing_extra

_SPACE = "@ros2_lv"
_LETTERS: dict[Kind, str] = {"publisher": "MP", "subscriber": "MS"}
_KINDS: dict[str, Kind] = {letters: kind for kind, letters in _LETTERS.items()}
_DEFAULT_DEPTH = 42
_ATTACHMENT = struct.Struct("<qqB16s")


class RmwDialect:
    """Keys and tokens in the ROS domain ``domain``, with the type hashes of ``store``."""

    name = "rmw"
    tokens: tuple[str, ...]

    def __init__(self, store: MessageStore, domain: int = 0) -> None:
        self._store, self._domain = store, domain
        self.tokens = (f"{_SPACE}/{domain}/**",)

    def publish_key(self, topic: Topic) -> str:
        """See ``Dialect``."""
        return f"{self._base(topic)}/{self._store.type_hash(topic.type)}"

    def subscribe_key(self, topic: Topic) -> str:
        """See ``Dialect``: any hash, so that another distribution is heard, and can be named."""
        return f"{self._base(topic)}/*"

    def node_token(self, party: Party) -> str | None:
        """See ``Dialect``."""
        return f"{_SPACE}/{self._domain}/{party.session}/0/0/NN/%/%/{party.node}"

    def token(self, kind: Kind, topic: Topic, party: Party, number: int) -> str:
        """See ``Dialect``."""
        return "/".join(
            (
                f"{_SPACE}/{self._domain}/{party.session}/0/{number}/{_LETTERS[kind]}/%/%",
                party.node,
                topic.name.replace("/", "%"),
                _dds_type(topic.type),
                self._store.type_hash(topic.type),
                quality_text(topic.quality),
            )
        )

    def read_token(self, key: str) -> Endpoint | None:
        """See ``Dialect``."""
        chunks = key.split("/")
        # Newer versions may say more behind what is known.
        if len(chunks) < 13 or chunks[0] != _SPACE or chunks[5] not in _KINDS:
            return None
        if chunks[1] != str(self._domain):
            return None
        namespace = chunks[7].replace("%", "/").rstrip("/")
        return Endpoint(
            kind=_KINDS[chunks[5]],
            topic=chunks[9].replace("%", "/"),
            type=ros_type(chunks[10]),
            type_hash=chunks[11],
            session=chunks[2],
            node=f"{namespace}/{chunks[8]}",
        )

    def hash_in(self, key: str) -> str:
        """See ``Dialect``."""
        return key.rpartition("/")[2]

    def attachment(self, token: str, sequence: int, stamp: int) -> bytes | None:
        """See ``Dialect``: sequence number, time, and the publisher's id as 16 bytes."""
        return _ATTACHMENT.pack(sequence, stamp, 16, gid_of(token))

    def _base(self, topic: Topic) -> str:
        return f"{self._domain}/{topic.name.strip('/')}/{_dds_type(topic.type)}"


def gid_of(token: str) -> bytes:
    """The id of the endpoint with ``token``, as other nodes compute it."""
    try:
        import xxhash
    except ImportError:
        raise missing_extra("xxhash") from None
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def read_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Sequence number, ns and id of an attachment; raises ValueError for other bytes."""
    if len(data) != _ATTACHMENT.size:
        raise ValueError(f"an attachment has {_ATTACHMENT.size} bytes, not {len(data)}")
    sequence, stamp, length, gid = _ATTACHMENT.unpack(data)
    if length != 16:
        raise ValueError(f"an attachment's id has 16 bytes, not {length}")
    return sequence, stamp, gid


def quality_text(quality: Quality) -> str:
    """A quality in a token; what is ROS's default is left out."""
    reliability = "" if quality.reliable else "2"
    durability = "1" if quality.transient_local else ""
    depth = "" if quality.depth == _DEFAULT_DEPTH else str(quality.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"


def _dds_type(name: str) -> str:
    package, middle, short = name.split("/")
    return f"{package}::{middle}::dds_::{short}_"


def ros_type(name: str) -> str:
    """sensor_msgs/msg/LaserScan of sensor_msgs::msg::dds_::LaserScan_."""
    parts = [part for part in name.split("::") if part != "dds_"]
    return "/".join((*parts[:-1], parts[-1].removesuffix("_")))
