"""zenoh-bridge-ros2dds: ROS 2 nodes that speak DDS, behind a bridge to Zenoh.

A key is the topic's name alone, so neither type nor distribution can be seen in a message; tokens
name the type. Whoever announces a publisher is given a DDS writer by the bridge.
"""

from __future__ import annotations

from lndrl.robot.link.dialect import Endpoint, Kind, Party, Quality, Topic

_SPACE = "@ros2_lv"
_SLASH = "§"
_LETTERS: dict[Kind, str] = {"publisher": "MP", "subscriber": "MS"}
_KINDS: dict[str, Kind] = {letters: kind for kind, letters in _LETTERS.items()}


class BridgeDialect:
    """Keys and tokens of the bridge (1.x; tokens of before 1.0 are read, too)."""

    name = "bridge"
    tokens: tuple[str, ...] = (f"@/*/{_SPACE}/**", f"{_SPACE}/*/*/*/*/*")

    def publish_key(self, topic: Topic) -> str:
        """See ``Dialect``."""
        return topic.name.strip("/")

    def subscribe_key(self, topic: Topic) -> str:
        """See ``Dialect``."""
        return topic.name.strip("/")

    def node_token(self, party: Party) -> str | None:
        """See ``Dialect``: the bridge knows sessions, which must come before their endpoints."""
        return f"@/{party.session}/{_SPACE}"

    def token(self, kind: Kind, topic: Topic, party: Party, number: int) -> str:
        """See ``Dialect``."""
        key, type_ = (_escaped(each) for each in (self.publish_key(topic), topic.type))
        quality = quality_text(topic.quality)
        return f"@/{party.session}/{_SPACE}/{_LETTERS[kind]}/{key}/{type_}/{quality}"

    def read_token(self, key: str) -> Endpoint | None:
        """See ``Dialect``."""
        chunks = key.split("/")
        if chunks[:1] == ["@"] and chunks[2:3] == [_SPACE]:
            session, chunks = chunks[1], chunks[3:]
        elif chunks[0] == _SPACE:
            session, chunks = chunks[1], chunks[2:]
        else:
            return None
        if len(chunks) != 4 or chunks[0] not in _KINDS:
            return None
        topic, type_ = (chunk.replace(_SLASH, "/") for chunk in chunks[1:3])
        return Endpoint(_KINDS[chunks[0]], f"/{topic}", type_, "", session, "")

    def hash_in(self, key: str) -> str:
        """See ``Dialect``."""
        return ""

    def attachment(self, token: str, sequence: int, stamp: int) -> bytes | None:
        """See ``Dialect``: topics have none."""
        return None


def quality_text(quality: Quality) -> str:
    """A quality in a token, by DDS's numbers; an empty first part says: a type without keys."""
    return f":{int(quality.reliable)}:{int(quality.transient_local)}:0,{quality.depth}"


def _escaped(name: str) -> str:
    return name.replace("/", _SLASH)
