"""The keys under which learner, actors and dashboards meet; a namespace goes before them."""

from __future__ import annotations

PREFIX = "lndrl"
HELLO = f"{PREFIX}/hello"
UPLOAD = f"{PREFIX}/upload"
WEIGHTS = f"{PREFIX}/weights"
TESTED = "t"
"""Before the number of a version: as evaluators test it, where actors act on other weights."""
ANNOUNCE = f"{PREFIX}/announce"
STATUS = f"{PREFIX}/status"
ACTORS = f"{PREFIX}/actors"
VALIDATION = f"{PREFIX}/validation"
OPERATION = f"{PREFIX}/operation"
PING = f"{PREFIX}/ping"
WORLDS = f"{PREFIX}/worlds"


def upload_key(lane: str) -> str:
    """What all uploads of a ``lane`` begin with; the empty one is all there is without ranks."""
    return f"{UPLOAD}/{lane}" if lane else UPLOAD


def world_key(actor_id: str) -> str:
    """Under which an actor shows a world of its own."""
    return f"{WORLDS}/{actor_id}"


def in_namespace(key: str, namespace: str) -> str:
    """``key`` as others on the router see it."""
    return f"{namespace}/{key}" if namespace else key
