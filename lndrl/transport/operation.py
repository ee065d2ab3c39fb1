"""What an operator may ask of a running learner, and how it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from lndrl.transport.messages import Limits, Message, MessageError, Refusal, decode, encode
from lndrl.version import VERSION

CHECKPOINT, STOP = "checkpoint", "stop"
REQUESTS = (CHECKPOINT, STOP)
"""A checkpoint now; an end that leaves a checkpoint and a run that can be resumed."""

_LONGEST = 200  # letters of a text


@dataclass(frozen=True)
class Request(Message):
    """An operator asks for ``action``, one of REQUESTS, of the run ``run_id``.

    ``sender`` says who, for the log: it is told, not proven.
    """

    KIND: ClassVar[str] = "request"
    action: str
    run_id: str
    sender: str

    def __post_init__(self) -> None:
        if self.action not in REQUESTS:
            raise MessageError(f"action must be one of {', '.join(REQUESTS)}")
        for name, value in (("run_id", self.run_id), ("sender", self.sender)):
            if not isinstance(value, str) or len(value) > _LONGEST:
                raise MessageError(f"{name} must be a text of at most {_LONGEST} letters")


@dataclass(frozen=True)
class Granted(Message):
    """The learner does it; ``sentence`` says what and when."""

    KIND: ClassVar[str] = "granted"
    sentence: str

    def __post_init__(self) -> None:
        if not isinstance(self.sentence, str) or len(self.sentence) > 10 * _LONGEST:
            raise MessageError("sentence must be a text")


class OperatorHandlers(Protocol):
    """The learner's answers to operators, called on a transport's thread, one at a time."""

    def on_request(self, request: Request) -> Granted | Refusal:
        """Do it soon, or refuse; returns at once."""
        ...


def answer(data: bytes, handlers: OperatorHandlers | None, limits: Limits) -> bytes:
    """Granted or Refusal to an encoded Request; what is none is refused here."""
    if handlers is None:
        return encode(Refusal("this learner takes no requests"))
    try:
        request, _ = decode(data, Request, limits=limits)
    except MessageError as error:
        text = f"the learner (lndrl {VERSION}) does not understand this request"
        return encode(Refusal(f"{text} ({str(error)[:500]}); install the same lndrl version"))
    return encode(handlers.on_request(request))


def sentence_of(data: bytes) -> str:
    """What an encoded answer says, a refusal as one."""
    try:
        found, _ = decode(data, Granted, Refusal)
    except MessageError:
        return "the learner's answer cannot be read; install the same lndrl version on both sides"
    if isinstance(found, Granted):
        return found.sentence
    assert isinstance(found, Refusal)
    return f"refused: {found.reason}"
