"""Learners to examine, real and pretended, and what a test reads of the findings."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from lndrl.doctor.diagnosis import Target, diagnose
from lndrl.doctor.probes import Check
from lndrl.transport import (
    PROTOCOL_VERSION,
    WeightsAnnouncement,
    free_endpoint,
)
from lndrl.transport.keys import (
    ANNOUNCE,
    HELLO,
    OPERATION,
    PING,
    STATUS,
    UPLOAD,
    VALIDATION,
    WEIGHTS,
)
from lndrl.transport.messages import encode
from lndrl.transport.zenoh.session import open_session
from lndrl.version import VERSION

PATIENCE = 60.0  # s, for machines with much else to do
PONG = {"program_version": VERSION, "protocol": PROTOCOL_VERSION, "run_id": "first"}
NEWS = encode(WeightsAnnouncement(3, 10, "00000000", "one"))
TLS = "transport/link/tls"
ALL_KEYS = [PING, HELLO, ANNOUNCE, WEIGHTS, f"{UPLOAD}/**", STATUS, VALIDATION, OPERATION]


def mutual(folder: Path, **changed: Any) -> dict[str, Any]:
    """Settings of a learner that wants certificates."""
    files = {
        "root_ca_certificate": str(folder / "ca.pem"),
        "listen_certificate": str(folder / "learner.pem"),
        "listen_private_key": str(folder / "learner.key"),
        "enable_mtls": True,
    }
    return {f"{TLS}/{name}": value for name, value in (files | changed).items()}


def access(allowed: dict[str, list[str]], subject: str = "cert_common_names") -> dict[str, Any]:
    """Access control that lets each of the named ones use only its keys."""
    messages = ["query", "reply", "put", "declare_queryable", "declare_subscriber"]
    who = {"cert_common_names": "lndrl-{}", "usernames": "{}"}[subject]
    return {
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": [
                {
                    "id": name,
                    "permission": "allow",
                    "flows": ["ingress", "egress"],
                    "messages": messages,
                    "key_exprs": keys,
                }
                for name, keys in allowed.items()
            ],
            "subjects": [{"id": name, subject: [who.format(name)]} for name in allowed],
            "policies": [{"rules": [name], "subjects": [name]} for name in allowed],
        }
    }


@contextmanager
def learner(
    scheme: str = "tcp",
    settings: dict[str, Any] | None = None,
    answers: dict[str, bytes | None] | None = None,
) -> Iterator[str]:
    """A session that listens, answers and publishes like a learner; None answers nothing."""
    endpoint = f"{scheme}/{free_endpoint().partition('/')[2]}"
    session = open_session(
        {
            "mode": "router",
            "listen/endpoints": [endpoint],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "scouting/delay": 0,
            **(settings or {}),
        },
        PATIENCE,
    )
    replies: dict[str, bytes | None] = dict.fromkeys(ALL_KEYS, b"here")
    replies |= {PING: json.dumps(PONG).encode(), ANNOUNCE: NEWS} | (answers or {})

    def answering(data: bytes) -> Callable[[zenoh.Query], None]:
        def reply(query: zenoh.Query) -> None:
            with query:
                query.reply(query.key_expr, data)

        return reply

    closed = threading.Event()

    def publish() -> None:
        while not closed.wait(0.1):
            for key in (ANNOUNCE, STATUS):
                if replies[key] is not None:
                    session.put(key, replies[key])

    publisher = threading.Thread(target=publish)
    try:
        for key, data in replies.items():
            if data is not None:
                session.declare_queryable(key, answering(data))
        publisher.start()
        yield endpoint
    finally:
        closed.set()
        publisher.join()
        session.close()


def examine(endpoint: str, **given: Any) -> dict[str, Check]:
    """The checks by name; none comes twice."""
    checks = list(diagnose(Target(endpoint, **{"timeout": PATIENCE, **given})))
    found = {check.name: check for check in checks}
    assert len(found) == len(checks)
    assert all(check.text and "\n" not in check.text for check in checks)
    return found


def failed(checks: dict[str, Check]) -> list[str]:
    return [check.name for check in checks.values() if check.state == "failed"]
