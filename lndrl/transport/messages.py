"""The messages between learner, actors and dashboards; both sides share these definitions.

Every message is a frozen dataclass that checks itself when built, so an object of these types is
valid wherever it came from. ``encode`` and ``decode`` turn them into bytes and back.
"""

from __future__ import annotations

import dataclasses
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self, TypeVar

from numpy.typing import NDArray

from lndrl.transport.wire import (
    DEFAULT_LIMITS,
    Limits,
    MessageError,
    TooLargeError,
    pack,
    unpack,
)

__all__ = [
    "ACK_STATUSES",
    "COUNTS",
    "DEFAULT_LIMITS",
    "NO_WEIGHTS",
    "PROTOCOL_VERSION",
    "UNKNOWN_ACTOR",
    "Ack",
    "ChunkHeader",
    "EvaluatorHello",
    "Hello",
    "Limits",
    "Message",
    "MessageError",
    "Refusal",
    "TooLargeError",
    "ValidationResult",
    "ValidationTask",
    "WeightsAnnouncement",
    "Welcome",
    "decode",
    "digest",
    "encode",
    "pack",
    "unpack",
]

PROTOCOL_VERSION = 1
NO_WEIGHTS = -1
UNKNOWN_ACTOR = "unknown_actor"
ACK_STATUSES = ("accepted", "duplicate", "stale", "refused", "pause")
COUNTS = ("episodes", "arrived", "collided", "lost", "timeout", "steps")
"""What is counted of validation episodes: how many, how they ended, and their control steps."""

MAX_TEXT = 2000
MAX_INTEGER = 2**53
MAX_ACTIVITIES = 32
MAX_SECONDS = 1e9
IDENTIFIER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,63}\Z")


def _text(name: str, value: Any, empty: bool = True) -> None:
    if not isinstance(value, str) or len(value) > MAX_TEXT or not (empty or value):
        raise MessageError(f"{name} must be a text of at most {MAX_TEXT} letters")


def _identifier(name: str, value: Any) -> None:
    if not isinstance(value, str) or not IDENTIFIER.match(value):
        raise MessageError(f"{name} must be 1 to 64 letters, digits, '_', '.', '-'")


def _integer(name: str, value: Any, least: int = 0) -> None:
    if type(value) is not int or not least <= value < MAX_INTEGER:
        raise MessageError(f"{name} must be a whole number of at least {least}")


def _boolean(name: str, value: Any) -> None:
    if type(value) is not bool:
        raise MessageError(f"{name} must be true or false")


def _machine(value: Any) -> None:
    most = {"cpu": 1.0, "memory": 1.0, "cores": 1e6, "gigabytes": 1e9}
    most |= {"gpu": 1.0, "gpu_memory": 1.0, "gpus": 1e4}
    if not isinstance(value, dict) or not all(
        type(each) is float and 0 <= each <= most.get(key, -1.0) for key, each in value.items()
    ):
        raise MessageError(f"machine must map some of {', '.join(most)} to numbers in range")


@dataclass(frozen=True)
class Message:
    """A message as a dataclass; ``KIND`` names it on the wire."""

    KIND: ClassVar[str]

    def to_dict(self) -> dict[str, Any]:
        """The fields as a plain dict (shallow)."""
        return {name: getattr(self, name) for name in _fields(type(self))[0]}

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """A message from plain data; raises MessageError for missing, unknown or wrong fields."""
        if not isinstance(data, dict):
            raise MessageError(f"{cls.KIND} must be a map")
        known, required = _fields(cls)
        for key in data:
            if key not in known:
                raise MessageError(f"{cls.KIND} has an unknown field {key!r}")
        for name in required:
            if name not in data:
                raise MessageError(f"{cls.KIND} lacks the field {name}")
        return cls(**data)


_FIELDS: dict[str, tuple[dict[str, None], tuple[str, ...]]] = {}


def _fields(message: type[Message]) -> tuple[dict[str, None], tuple[str, ...]]:
    """Names of a message's fields, and of those that have no default; looked up once per kind."""
    found = _FIELDS.get(message.KIND)
    if found is None:
        fields = dataclasses.fields(message)
        required = [
            f.name
            for f in fields
            if f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
        ]
        found = _FIELDS[message.KIND] = dict.fromkeys(f.name for f in fields), tuple(required)
    return found


@dataclass(frozen=True)
class Hello(Message):
    """An actor introduces itself. ``incarnation`` is random for every start of the process.

    One that compiles kernels before it can begin says so again and again: how many of those that
    it needs are ready.
    """

    KIND: ClassVar[str] = "hello"
    actor_id: str
    incarnation: str
    host: str
    pid: int
    worlds: int
    program_version: str
    protocol: int = PROTOCOL_VERSION
    kernels_ready: int = 0
    kernels_needed: int = 0

    def __post_init__(self) -> None:
        _integer("kernels_ready", self.kernels_ready)
        _integer("kernels_needed", self.kernels_needed)
        _identifier("actor_id", self.actor_id)
        _identifier("incarnation", self.incarnation)
        _text("host", self.host)
        _integer("pid", self.pid)
        _integer("worlds", self.worlds, 1)
        _text("program_version", self.program_version)
        _integer("protocol", self.protocol)


@dataclass(frozen=True)
class Welcome(Message):
    """The learner's answer: the run and its configuration.

    ``lane``: where this actor's uploads go, in a learner of several ranks; empty for the one there
    is. ``weights_version`` (NO_WEIGHTS before the first) and ``learner_incarnation`` are filled in
    by the transport.
    """

    KIND: ClassVar[str] = "welcome"
    run_id: str
    config: dict[str, Any]
    actor_index: int
    weights_version: int = NO_WEIGHTS
    learner_incarnation: str = ""
    lane: str = ""

    def __post_init__(self) -> None:
        _text("run_id", self.run_id, empty=False)
        if self.lane != "":
            _identifier("lane", self.lane)
        if not isinstance(self.config, dict):
            raise MessageError("config must be a map")
        _integer("actor_index", self.actor_index)
        _integer("weights_version", self.weights_version, NO_WEIGHTS)
        _text("learner_incarnation", self.learner_incarnation)


@dataclass(frozen=True)
class Refusal(Message):
    """The learner does not want this actor; ``reason`` is a sentence for the user."""

    KIND: ClassVar[str] = "refusal"
    reason: str

    def __post_init__(self) -> None:
        _text("reason", self.reason)


@dataclass(frozen=True)
class ChunkHeader(Message):
    """What an upload says about itself; its arrays travel beside it.

    ``sequence`` counts the uploads of one incarnation from 1. ``timing`` holds seconds per
    activity since the last chunk, ``episodes`` the records of episodes that ended in the chunk,
    ``machine`` how busy the actor's host is (``status.Machine``; empty: not known).
    """

    KIND: ClassVar[str] = "chunk"
    run_id: str
    actor_id: str
    incarnation: str
    sequence: int
    steps: int
    worlds: int
    episodes: list[dict[str, Any]] = field(default_factory=list)
    timing: dict[str, float] = field(default_factory=dict)
    host: str = ""
    pid: int = 0
    machine: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _machine(self.machine)
        _text("run_id", self.run_id, empty=False)
        _identifier("actor_id", self.actor_id)
        _identifier("incarnation", self.incarnation)
        _integer("sequence", self.sequence)
        _integer("steps", self.steps)
        _integer("worlds", self.worlds, 1)
        if not isinstance(self.episodes, list) or not all(
            isinstance(episode, dict) for episode in self.episodes
        ):
            raise MessageError("episodes must be a list of maps")
        if (
            not isinstance(self.timing, dict)
            or len(self.timing) > MAX_ACTIVITIES
            or not all(
                isinstance(key, str)
                and isinstance(value, (int, float))
                and abs(value) <= MAX_SECONDS  # false for NaN
                for key, value in self.timing.items()
            )
        ):
            raise MessageError(f"timing must map at most {MAX_ACTIVITIES} names to finite seconds")
        _text("host", self.host)
        _integer("pid", self.pid)


@dataclass(frozen=True)
class Ack(Message):
    """The learner's answer to an upload.

    ``accepted``, ``duplicate``, ``stale`` and ``refused`` settle the chunk, except ``refused``
    with reason UNKNOWN_ACTOR (a restarted learner: say hello, the chunk is then sent again);
    ``pause`` means not taken, send again a little later. ``done``: training has finished.
    ``weights_version`` and ``learner_incarnation`` are filled in by the transport.
    """

    KIND: ClassVar[str] = "ack"
    status: str
    weights_version: int = NO_WEIGHTS
    learner_incarnation: str = ""
    reason: str = ""
    done: bool = False

    def __post_init__(self) -> None:
        if self.status not in ACK_STATUSES:
            raise MessageError(f"status must be one of {', '.join(ACK_STATUSES)}")
        _integer("weights_version", self.weights_version, NO_WEIGHTS)
        _text("learner_incarnation", self.learner_incarnation)
        _text("reason", self.reason)
        _boolean("done", self.done)


@dataclass(frozen=True)
class WeightsAnnouncement(Message):
    """The newest weights: version, bytes, digest. Repeated every second; ``done`` as in Ack."""

    KIND: ClassVar[str] = "weights"
    version: int
    size: int
    digest: str
    learner_incarnation: str
    done: bool = False

    def __post_init__(self) -> None:
        _integer("version", self.version, NO_WEIGHTS)
        _integer("size", self.size)
        _text("digest", self.digest)
        _text("learner_incarnation", self.learner_incarnation)
        _boolean("done", self.done)


@dataclass(frozen=True)
class EvaluatorHello(Message):
    """An evaluator asks what to validate; ``incarnation`` as in Hello.

    Not ``ready``, it rests: it only wants to know whether training goes on.
    """

    KIND: ClassVar[str] = "evaluator"
    evaluator_id: str
    incarnation: str
    host: str
    pid: int
    program_version: str
    protocol: int = PROTOCOL_VERSION
    ready: bool = True

    def __post_init__(self) -> None:
        _boolean("ready", self.ready)
        _identifier("evaluator_id", self.evaluator_id)
        _identifier("incarnation", self.incarnation)
        _text("host", self.host)
        _integer("pid", self.pid)
        _text("program_version", self.program_version)
        _integer("protocol", self.protocol)


@dataclass(frozen=True)
class ValidationTask(Message):
    """The learner's answer: the weights version to validate, NO_WEIGHTS while none is new.

    ``config`` is the run's, which says how many episodes, and what share of a core they may take.
    ``learner_incarnation`` is filled in by the transport; ``done`` as in Ack.
    """

    KIND: ClassVar[str] = "validation_task"
    run_id: str
    config: dict[str, Any]
    version: int = NO_WEIGHTS
    learner_incarnation: str = ""
    done: bool = False

    def __post_init__(self) -> None:
        _text("run_id", self.run_id, empty=False)
        if not isinstance(self.config, dict):
            raise MessageError("config must be a map")
        _integer("version", self.version, NO_WEIGHTS)
        _text("learner_incarnation", self.learner_incarnation)
        _boolean("done", self.done)


@dataclass(frozen=True)
class ValidationResult(Message):
    """What became of the validation episodes under one version; answered by an Ack.

    ``learner_incarnation`` is the learner's that gave the weights: another one may have published
    others under the same version. ``sampled`` and ``greedy`` hold COUNTS, ``seconds`` of wall time
    went into both.
    """

    KIND: ClassVar[str] = "validation"
    run_id: str
    evaluator_id: str
    incarnation: str
    learner_incarnation: str
    version: int
    seconds: float
    sampled: dict[str, int]
    greedy: dict[str, int]

    def __post_init__(self) -> None:
        _text("run_id", self.run_id, empty=False)
        _identifier("evaluator_id", self.evaluator_id)
        _identifier("incarnation", self.incarnation)
        _text("learner_incarnation", self.learner_incarnation, empty=False)
        _integer("version", self.version)
        number = isinstance(self.seconds, float | int) and not isinstance(self.seconds, bool)
        if not (number and 0.0 <= self.seconds <= MAX_SECONDS):
            raise MessageError(f"seconds must be a number from 0 to {MAX_SECONDS:g}")
        _counts("sampled", self.sampled)
        _counts("greedy", self.greedy)


def _counts(name: str, value: Any) -> None:
    if not isinstance(value, dict) or set(value) != set(COUNTS):
        raise MessageError(f"{name} must hold {', '.join(COUNTS)}, and nothing else")
    for key, count in value.items():
        _integer(f"{name}.{key}", count)
    if value["episodes"] != sum(value[key] for key in COUNTS[1:-1]):
        raise MessageError(f"{name}: {value['episodes']} episodes did not end as they are counted")
    if value["steps"] < value["episodes"]:
        raise MessageError(f"{name}: an episode has at least one step")


MESSAGES: dict[str, type[Message]] = {
    kind.KIND: kind
    for kind in (
        *(Hello, Welcome, Refusal, ChunkHeader, Ack, WeightsAnnouncement),
        *(EvaluatorHello, ValidationTask, ValidationResult),
    )
}
M = TypeVar("M", bound=Message)


def encode(message: Message, arrays: Mapping[str, NDArray[Any]] | None = None) -> bytes:
    """A message and its arrays as bytes; raises MessageError for what cannot be sent."""
    return pack({"kind": message.KIND, "body": message.to_dict()}, arrays)


def encode_chunk(header: ChunkHeader, arrays: Mapping[str, NDArray[Any]], megabytes: int) -> bytes:
    """An upload as bytes; raises TooLargeError beyond what the learner's configuration allows."""
    payload = encode(header, arrays)
    if len(payload) > megabytes * 2**20:
        raise TooLargeError(
            f"a chunk of {len(payload) / 2**20:.3g} MiB exceeds the {megabytes} of the learner's"
            " transport.max_message_megabytes; use fewer worlds, a shorter actor.horizon, or raise"
            " it"
        )
    return payload


def decode(
    data: bytes | bytearray | memoryview, *expected: type[M], limits: Limits = DEFAULT_LIMITS
) -> tuple[M, dict[str, NDArray[Any]]]:
    """Message and arrays in ``data``; raises MessageError unless it is one of ``expected``."""
    header, arrays = unpack(data, limits)
    kind = header.get("kind")
    for candidate in expected:
        if kind == candidate.KIND and set(header) == {"kind", "body"}:
            return candidate.from_dict(header["body"]), arrays
    wanted = " or ".join(candidate.KIND for candidate in expected)
    raise MessageError(f"expected {wanted}, not {str(kind)[:40]!r}")


def digest(blob: bytes) -> str:
    """Eight hex digits that tell a damaged blob of weights.

    A checksum: both sides take it with every version, and a hash of 30 MB costs five times that.
    """
    return f"{zlib.crc32(blob):08x}"
