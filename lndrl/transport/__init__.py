"""Everything between processes: typed messages, uploads with acks, weights, status.

Zenoh is imported when an endpoint is opened, so the in-memory transport needs no network.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from lndrl.config import TransportConfig
from lndrl.transport.interface import (
    ActorEndpoint,
    EvaluatorEndpoint,
    LearnerEndpoint,
    LearnerHandlers,
    LearnerUnreachableError,
    RankEndpoint,
    ValidationHandlers,
    ViewerEndpoint,
    WeightsGoneError,
)
from lndrl.transport.memory import MemoryNetwork
from lndrl.transport.messages import (
    COUNTS,
    DEFAULT_LIMITS,
    NO_WEIGHTS,
    PROTOCOL_VERSION,
    UNKNOWN_ACTOR,
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Limits,
    MessageError,
    Refusal,
    TooLargeError,
    ValidationResult,
    ValidationTask,
    WeightsAnnouncement,
    Welcome,
    pack,
    unpack,
)
from lndrl.transport.security.exposure import reachable
from lndrl.transport.security.identity import Security

if TYPE_CHECKING:
    from lndrl.transport.zenoh.site import ZenohSite

__all__ = [
    "COUNTS",
    "DEFAULT_LIMITS",
    "NO_WEIGHTS",
    "PROTOCOL_VERSION",
    "UNKNOWN_ACTOR",
    "Ack",
    "ActorEndpoint",
    "ChunkHeader",
    "EvaluatorEndpoint",
    "EvaluatorHello",
    "Hello",
    "LearnerEndpoint",
    "LearnerHandlers",
    "LearnerUnreachableError",
    "Limits",
    "MemoryNetwork",
    "MessageError",
    "RankEndpoint",
    "Refusal",
    "Security",
    "TooLargeError",
    "ValidationHandlers",
    "ValidationResult",
    "ValidationTask",
    "ViewerEndpoint",
    "WeightsAnnouncement",
    "WeightsGoneError",
    "Welcome",
    "free_endpoint",
    "open_actor",
    "open_evaluator",
    "open_learner",
    "open_rank",
    "open_site",
    "open_viewer",
    "pack",
    "reachable",
    "unpack",
]


def open_learner(
    config: TransportConfig, run_id: str = "", security: Security | None = None, lane: str = ""
) -> LearnerEndpoint:
    """Listen at ``config.endpoint``; raises UserError when the port is taken or the address bad.

    Without ``security`` plain TCP, and loopback only. ``lane``: see ``Welcome``.
    """
    from lndrl.transport.zenoh.learner import ZenohLearner

    return ZenohLearner(config, run_id, security, lane)


def open_rank(
    config: TransportConfig, lane: str, incarnation: str, security: Security | None = None
) -> RankEndpoint:
    """Another rank of the learner at ``config.endpoint``; raises UserError when not let in."""
    from lndrl.transport.zenoh.rank import ZenohRank

    return ZenohRank(config, lane, incarnation, security)


def open_actor(
    endpoint: str, config: TransportConfig | None = None, security: Security | None = None
) -> ActorEndpoint:
    """An actor of the learner at ``endpoint``; raises UserError for a bad address."""
    from lndrl.transport.zenoh.actor import ZenohActor

    return ZenohActor(endpoint, config, security)


def open_evaluator(
    endpoint: str, config: TransportConfig | None = None, security: Security | None = None
) -> EvaluatorEndpoint:
    """An evaluator of the learner at ``endpoint``; raises UserError for a bad address."""
    from lndrl.transport.zenoh.evaluator import ZenohEvaluator

    return ZenohEvaluator(endpoint, config, security)


def open_site(
    connect: str,
    config: TransportConfig,
    upwards: Security | None = None,
    security: Security | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> ZenohSite:
    """A site's door at ``config.endpoint`` for the learner at ``connect``; raises UserError.

    ``upwards`` protects the side of the learner, ``security`` that of the actors.
    """
    from lndrl.transport.zenoh.site import ZenohSite

    return ZenohSite(connect, config, upwards, security, say)


def open_viewer(
    endpoint: str, config: TransportConfig | None = None, security: Security | None = None
) -> ViewerEndpoint:
    """A dashboard of the learner at ``endpoint``; raises UserError for a bad address."""
    from lndrl.transport.zenoh.viewer import ZenohViewer

    return ZenohViewer(endpoint, config, security)


def free_endpoint(host: str = "127.0.0.1") -> str:
    """An endpoint on a port that is free at this moment."""
    from lndrl.transport.zenoh.session import free_endpoint as find

    return find(host)
