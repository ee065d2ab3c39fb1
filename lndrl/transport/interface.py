"""What learner, actor and dashboard see of the transport, whatever carries it.

Two implementations: Zenoh between processes, memory within one (``--serial``, tests).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from lndrl.config import TransportConfig
from lndrl.errors import UserError
from lndrl.transport.frames import Watching
from lndrl.transport.messages import (
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Refusal,
    ValidationResult,
    ValidationTask,
    Welcome,
)
from lndrl.transport.operation import OperatorHandlers


class WeightsGoneError(LookupError):
    """The learner no longer keeps the wanted version (it keeps the last two)."""


class LearnerUnreachableError(UserError):
    """No learner answered a hello in time; one may still come."""


class LearnerHandlers(Protocol):
    """The learner's answers. Called on the transport's threads, one at a time per method."""

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        """Welcome or refuse an actor; asked again for the same incarnation after lost replies."""
        ...

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, NDArray[Any]], size: int) -> Ack:
        """Take an upload of ``size`` bytes; may block, then the actors wait.

        ``arrays`` are read-only views that keep the message alive. A chunk can arrive twice, and
        within the window out of order: remember a few sequences per (actor_id, incarnation).
        """
        ...

    def on_malformed(self, reason: str) -> None:
        """Hear of an upload that could not be read and was refused."""
        ...

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        """An actor's session appeared or vanished; a hint, the last chunk is the truth."""
        ...


class ValidationHandlers(Protocol):
    """The learner's answers to evaluators, called on a transport's thread, one at a time."""

    def on_evaluator(self, hello: EvaluatorHello) -> ValidationTask | Refusal:
        """Say what to validate, or refuse."""
        ...

    def on_validation(self, result: ValidationResult) -> Ack:
        """Take a result: accepted, duplicate, stale (of weights that are forgotten) or refused."""
        ...


class LearnerEndpoint(Protocol):
    """The learner's side."""

    incarnation: str
    largest_message: int
    """Bytes of what is received; larger messages vanish or are refused."""

    def start(
        self,
        handlers: LearnerHandlers,
        validation: ValidationHandlers | None = None,
        operator: OperatorHandlers | None = None,
    ) -> None:
        """Begin to answer; without ``validation`` evaluators are refused, as operators are."""
        ...

    def publish_weights(self, version: int, blob: bytes, tested: bytes | None = None) -> None:
        """Offer weights; announces them, keeps the last two versions. Never waits for actors.

        ``tested``: what evaluators get of this version, where it is not what actors act on.
        """
        ...

    def publish_status(self, snapshot: dict[str, Any], history: list[dict[str, Any]]) -> None:
        """Send ``snapshot`` to viewers; queries get ``{"snapshot", "history"}``."""
        ...

    def finish(self) -> None:
        """From now on acks and announcements say ``done``."""
        ...

    def close(self) -> None:
        """Stop answering; returns within seconds, can be called twice."""
        ...


class RankEndpoint(Protocol):
    """The side of a learner's rank other than 0: it takes in the uploads of its lane."""

    largest_message: int

    def start(self, handlers: LearnerHandlers) -> None:
        """Begin to answer."""
        ...

    def note_version(self, version: int) -> None:
        """The newest weights, which rank 0 has."""
        ...

    def finish(self) -> None:
        """From now on acks say ``done``."""
        ...

    def close(self) -> None:
        """Stop answering; returns within seconds, can be called twice."""
        ...


class ActorEndpoint(Protocol):
    """An actor's side. ``hello`` comes first; all methods are for one thread."""

    def hello(self, hello: Hello, timeout: float = 10.0) -> Welcome:
        """Introduce the actor; again when ``needs_hello`` says so, kept chunks follow.

        Raises UserError when refused, its subclass LearnerUnreachableError when no learner
        answers within ``timeout`` seconds, or at once where its host name is unknown.
        """
        ...

    def tell(self, hello: Hello) -> None:
        """Say hello again without heeding an answer: what is new about this actor.

        Never raises, and returns at once.
        """
        ...

    def upload(
        self,
        header: ChunkHeader,
        arrays: Mapping[str, NDArray[Any]],
        timeout: float | None = None,
    ) -> None:
        """Send a chunk; blocks while the window is full, but not while ``needs_hello``.

        The chunk is kept and sent again, under the same sequence, until a learner settles it.
        Raises MessageError for what cannot be sent, its subclass TooLargeError (a UserError) for
        what the learner would not receive, RuntimeError when closed or without hello,
        and TimeoutError when there was no room within ``timeout`` seconds: then the chunk was
        not taken, call again.
        """
        ...

    def keep_book(self, path: Path) -> None:
        """Note in ``path`` every chunk that is taken and every one that is settled.

        Call it before the first upload. Lines are JSON, ``kind`` produced or settled. Raises
        UserError when the file cannot be written.
        """
        ...

    def adopt(self, config: TransportConfig) -> None:
        """Take over what the run's configuration says of uploads: patience, window, size."""
        ...

    def acks(self) -> list[Ack]:
        """Acks that settled chunks since the last call, oldest first."""
        ...

    def pending(self) -> int:
        """Chunks not yet settled."""
        ...

    def flush(self, timeout: float) -> bool:
        """Wait until every chunk is settled; False when time ran out or a hello is needed."""
        ...

    def needs_hello(self) -> bool:
        """True when another learner (a restarted one) answered: call ``hello`` again."""
        ...

    def done(self) -> bool:
        """True once the learner said that training has finished."""
        ...

    def silence(self) -> float:
        """Seconds since the learner was last heard; it speaks every second once it has weights."""
        ...

    def newest(self) -> tuple[int, str]:
        """Newest known (weights version, learner incarnation); version NO_WEIGHTS if none."""
        ...

    def wait_newer(self, version: int, timeout: float) -> bool:
        """Wait until ``newest`` is not ``version``, or ``done``, or ``needs_hello``; else False."""
        ...

    def fetch(self, version: int | None = None, timeout: float = 10.0) -> tuple[int, bytes]:
        """Weights as (version, blob), the newest by default.

        Raises WeightsGoneError when the version is gone, TimeoutError when none came in time,
        TooLargeError when this side receives no message of that size.
        """
        ...

    def watched(self) -> bool:
        """Whether somebody watches this actor's world now; may be asked in every step."""
        ...

    def show(self, frame: bytes) -> None:
        """Send an encoded ``WorldFrame`` to whoever watches. Never waits or raises; may be lost."""
        ...

    def close(self) -> None:
        """Leave; drops unsettled chunks (``flush`` first). Can be called twice."""
        ...


class EvaluatorEndpoint(Protocol):
    """An evaluator's side; all methods are for one thread."""

    def ask(self, hello: EvaluatorHello, timeout: float = 10.0) -> ValidationTask:
        """Ask what to validate.

        Raises UserError when refused or met by another version, its subclass
        LearnerUnreachableError when no learner answers within ``timeout`` seconds.
        """
        ...

    def fetch(self, version: int, timeout: float = 10.0) -> bytes:
        """The weights of ``version``.

        Raises WeightsGoneError when they are no longer kept, TimeoutError when none came in time.
        """
        ...

    def report(self, result: ValidationResult, timeout: float = 10.0) -> Ack | None:
        """Hand over a result; None when nobody answered, then it may be sent again."""
        ...

    def close(self) -> None:
        """Leave. Can be called twice."""
        ...


class ViewerEndpoint(Protocol):
    """A dashboard's side: reads, and asks for something where its role may."""

    def status(self, timeout: float = 5.0) -> dict[str, Any]:
        """``{"snapshot": ..., "history": [...]}``; raises UserError when none came in time."""
        ...

    def request(self, action: str, run_id: str, timeout: float = 5.0) -> str:
        """Ask for one of ``operation.REQUESTS``; a sentence that says what comes of it.

        Raises UserError, with why, when nobody answers within ``timeout`` seconds.
        """
        ...

    def watch(self, actor_id: str) -> Watching:
        """Have that actor show a world of its own, until what is returned is closed.

        Raises UserError when no learner can be reached.
        """
        ...

    def stream(self, silence: float | None = None) -> Iterator[dict[str, Any] | None]:
        """Snapshots as they are published, until ``close``.

        With ``silence``, yields None after every so many seconds without a snapshot.
        """
        ...

    def close(self) -> None:
        """Leave. Can be called twice."""
        ...
