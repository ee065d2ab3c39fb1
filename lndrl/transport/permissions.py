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

from lndrl.transport.messages import NO_WEIGHTS, MessageError, WeightsAnnouncement, decode
from lndrl.transport.probes import FAILED, OK, SKIPPED, Check
from lndrl.transport.zenoh_session import (
    ANNOUNCE,
    HELLO,
    PREFIX,
    STATUS,
    UPLOAD,
    WEIGHTS,
    ZenohSession,
    first_answer,
)

PING = f"{PREFIX}/ping"
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


_ASK_HELLO = Operation("hello", HELLO)
_ASK_ANNOUNCE = Operation("announce", ANNOUNCE)
# A version that no learner has: the answer is empty instead of megabytes.
_ASK_WEIGHTS = Operation("weights", WEIGHTS, b"9" * 20)
_UPLOAD = Operation("upload", f"{UPLOAD}/doctor/{secrets.token_hex(8)}/0")
_ASK_STATUS = Operation("status", STATUS)
_HEAR_ANNOUNCE = Operation("hear announce", ANNOUNCE, hears=True)
_HEAR_STATUS = Operation("hear status", STATUS, hears=True)
# A learner publishes and answers, which cannot be tried without disturbing a run.
OPERATIONS: dict[str, tuple[Operation, ...]] = {
    "learner": (),
    "actor": (_ASK_HELLO, _ASK_ANNOUNCE, _ASK_WEIGHTS, _UPLOAD, _HEAR_ANNOUNCE),
    "dashboard": (_ASK_STATUS, _HEAR_STATUS),
}
ROLES = tuple(OPERATIONS)


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
        no_weights = no_weights or (one is _ASK_ANNOUNCE and _has_no_weights(sample))
    for one, channel in hearing.items():
        if one is _HEAR_ANNOUNCE and no_weights:
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
