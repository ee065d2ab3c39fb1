"""What each role must be allowed, and whether the other side allows it.

zenoh's access control denies silently: nothing comes back. So each operation is one that a learner
always answers, or something that it repeats every second.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import zenoh

from lndrl.doctor.probes import FAILED, OK, SKIPPED, Check
from lndrl.transport.keys import ANNOUNCE, PING, PREFIX, STATUS, UPLOAD, WEIGHTS
from lndrl.transport.messages import NO_WEIGHTS, MessageError, WeightsAnnouncement, decode
from lndrl.transport.security.access import EVERY_UPLOAD, EVERY_WORLD, RIGHTS, ROLES, Right
from lndrl.transport.zenoh.session import ZenohSession, first_answer

ANSWER_SECONDS = 3.0
# An upload waits behind those that the learner takes in while it learns.
UPLOAD_SECONDS = 10.0
# Announcements and status are repeated every second.
HEARING_SECONDS = 2.5


@dataclass(frozen=True)
class Operation:
    """Something that a role must be allowed: a question, or hearing what is published."""

    name: str
    key: str
    payload: bytes = b""
    hears: bool = False


# A version of weights that no learner has: the answer is empty instead of megabytes.
_NO_VERSION = b"9" * 20
_LIFE = secrets.token_hex(8)  # the incarnation under which nothing is uploaded


def _operation(right: Right) -> Operation | None:
    """How to try ``right``; None for what cannot be tried without leaving traces in a run."""
    if right.key == PING or right.action not in ("ask", "hear"):
        return None
    if right.key == EVERY_WORLD:  # silent unless an actor works there, who would then send
        return None
    name = right.key.removeprefix(f"{PREFIX}/").removesuffix("/**")
    if right.action == "hear":
        return Operation(f"hear {name}", right.key, hears=True)
    if right.key == EVERY_UPLOAD:
        return Operation(name, f"{UPLOAD}/doctor/{_LIFE}/0")
    return Operation(name, right.key, _NO_VERSION if right.key == WEIGHTS else b"")


OPERATIONS: dict[str, tuple[Operation, ...]] = {
    role: tuple(
        operation
        for right in RIGHTS
        if right.role == role and (operation := _operation(right)) is not None
    )
    for role in ROLES
}
"""What is tried of each role's rights; a learner's would disturb a run."""


def operations_of(role: str | None) -> tuple[Operation, ...]:
    """The operations of a role; of all roles where none is known."""
    if role is not None:
        return OPERATIONS[role]
    return tuple(dict.fromkeys(one for several in OPERATIONS.values() for one in several))


def check_operations(
    session: ZenohSession, operations: tuple[Operation, ...], who: str
) -> Iterator[Check]:
    """One check per operation; ``who`` is how the learner knows us.

    All are asked at once, because each may have to wait for nothing to come back.
    """
    hearing = {
        one: session.zenoh.declare_subscriber(one.key, zenoh.handlers.RingChannel(1))
        for one in operations
        if one.hears
    }
    deadline = time.monotonic() + HEARING_SECONDS
    asking = {
        one: session.ask(
            one.key, one.payload, UPLOAD_SECONDS if one.name == "upload" else ANSWER_SECONDS
        )
        for one in operations
        if not one.hears
    }
    no_weights = False
    for one, channel in asking.items():
        sample = first_answer(channel)
        if sample is None:
            yield Check(one.name, FAILED, _denied(one, who))
            continue
        yield Check(one.name, OK, f"{_generic(one.key)} answers")
        no_weights = no_weights or (one.key == ANNOUNCE and _has_no_weights(sample))
    for one, channel in hearing.items():
        if one.key == ANNOUNCE and no_weights:
            yield Check(one.name, SKIPPED, "the learner has no weights to announce yet")
        elif _hears(channel, deadline):
            yield Check(one.name, OK, f"{_generic(one.key)} is heard")
        else:
            yield Check(one.name, FAILED, _denied(one, who))


def _hears(channel: Any, deadline: float) -> bool:
    while channel.try_recv() is None:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def _has_no_weights(sample: zenoh.Sample) -> bool:
    try:
        news, _ = decode(sample.payload.to_bytes(), WeightsAnnouncement)
    except MessageError:
        return False
    return news.version == NO_WEIGHTS and not news.done


def _denied(one: Operation, who: str) -> str:
    what = "hear" if one.hears else "ask"
    text = (
        f"denied key: nothing came back from {_generic(one.key)} although {PING} answers; the"
        f" learner's access control does not let {who} {what} there: use the"
        " certificate or user of the right role, or correct the learner's settings"
    )
    if one.name == "upload":
        text += " (or the learner takes nothing in for a while)"
    elif one.key == STATUS:
        text += " (or the learner has only just started and has no status yet)"
    return text


def _generic(key: str) -> str:
    return f"{UPLOAD}/…" if key.startswith(UPLOAD) else key
