"""Why a connection to a learner does not work, step by step, in sentences.

Every step asks for one thing more than the one before, so the first that fails names the cause.
Nothing that is asked here changes anything in the learner: uploads and hellos are empty, which it
refuses as malformed, and that answer proves the way.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import zenoh

from lndrl.doctor.permissions import ANSWER_SECONDS, check_operations, operations_of
from lndrl.doctor.probes import (
    FAILED,
    OK,
    SKIPPED,
    Address,
    Check,
    check_name,
    check_port,
    check_tls,
    parse_address,
    speaks_tls,
)
from lndrl.errors import UserError
from lndrl.transport.keys import PING
from lndrl.transport.messages import PROTOCOL_VERSION
from lndrl.transport.security.access import ROLES, role_of
from lndrl.transport.security.identity import Security, settings
from lndrl.transport.zenoh.session import UnreachableError, ZenohSession, open_session
from lndrl.version import VERSION

# What does not speak TLS keeps silent when it is asked to.
TLS_SECONDS = 2.0


@dataclass(frozen=True)
class Target:
    """What to look at: an endpoint and how to show who we are. ``timeout`` in s per step."""

    endpoint: str
    role: str | None = None
    certificates: Path | None = None
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    namespace: str | None = None
    timeout: float = 5.0


def diagnose(target: Target) -> Iterator[Check]:
    """The checks in order, as they are done; nothing raises."""
    try:
        address = parse_address(target.endpoint)
    except UserError as error:
        yield Check("endpoint", FAILED, str(error))
        return
    if address.scheme == "tls" and ":" in address.host:
        # zenoh 1.10.2 takes the brackets for a part of the name and gives up before it connects.
        text = "zenoh cannot use an IPv6 address over TLS; write a host name that has this address"
        yield Check("endpoint", FAILED, f"{address}: {text}, and put it into the certificate")
        return
    yield Check("endpoint", OK, f"{address} reads right")
    unusable = _unusable(target)
    if unusable is not None:
        yield unusable
        return
    reached = True
    for name, look in (("name", check_name), ("tcp", check_port)):
        if reached:
            found = look(address, target.timeout)
            reached = found.state == OK
            yield found
        else:
            yield Check(name, SKIPPED, "the host has no address")
    for role in _roles(target):
        for found in _diagnose_role(address, replace(target, role=role), reached):
            yield found if role is None else replace(found, name=f"{role}: {found.name}")


def _unusable(target: Target) -> Check | None:
    """What is wrong with the options themselves."""
    if target.namespace is not None:
        try:
            plain = not set("*$?#") & set(str(zenoh.KeyExpr(target.namespace)))
        except zenoh.ZError:
            plain = False
        if not plain:
            text = f"namespace {target.namespace!r} is no key; write words with / between them"
            return Check("namespace", FAILED, text)
    if target.certificates is not None:
        try:
            os.listdir(target.certificates)
        except (FileNotFoundError, NotADirectoryError):
            return None  # check_files says it, per role.
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            text = f"{target.certificates} cannot be read ({reason.lower()})"
            return Check("certificates", FAILED, f"{text}; run as its owner or name another folder")
    return None


def _roles(target: Target) -> tuple[str | None, ...]:
    """The roles to try: the one that is wanted, the user's, or all that have a certificate."""
    named = None if target.user is None else role_of(target.user)
    wanted = target.role or (named if named in ROLES else None)
    if wanted is not None:
        return (wanted,)
    if target.certificates is not None:
        from lndrl.doctor.certificate_checks import roles_in

        return roles_in(target.certificates) or (None,)
    return (None,)


def _diagnose_role(address: Address, target: Target, reached: bool) -> Iterator[Check]:
    fits = False
    if target.certificates is not None:
        from lndrl.doctor.certificate_checks import check_files

        found, fits = check_files(target.certificates, target.role)
        yield found
    if target.user is not None:
        yield _check_user(target.user, target.role)
    if not reached:
        yield Check("session", SKIPPED, "the port cannot be reached")
        return
    if address.scheme == "tls":
        known = target.certificates is not None and (target.certificates / "ca.pem").exists()
        found = check_tls(
            address,
            target.certificates if known else None,
            target.role if fits else None,
            target.timeout,
        )
        yield found
        if found.state != OK:
            yield Check("session", SKIPPED, "TLS fails, zenoh would, too")
            return
    session = None
    try:
        try:
            session = _connect(address, target)
        except (zenoh.ZError, UnreachableError) as error:
            yield Check(
                "session", FAILED, _why_closed(address, target, isinstance(error, UnreachableError))
            )
            return
        yield Check("session", OK, f"the learner lets in {_who(target)}")
        yield from _inside(session, target)
    except zenoh.ZError:
        text = "the connection broke off while it was tried; look at the learner and try again"
        yield Check("connection", FAILED, text)
    finally:
        if session is not None:
            session.close()


def _check_user(user: str, role: str | None) -> Check:
    named = role_of(user)
    if named not in ROLES:
        text = f"user {user} has no role; a name starts with {', '.join(ROLES)}, e.g. actor-lab3"
        return Check("user", FAILED, text)
    if named != role:
        text = f"user {user} has the role {named}, not {role}; give --role {named} or another user"
        return Check("user", FAILED, text)
    return Check("user", OK, f"user {user} has the role {named}")


def _connect(address: Address, target: Target) -> ZenohSession:
    """A session for questions, with one attempt to open it. Raises ZError, UnreachableError."""
    security = Security(
        target.role or "", target.certificates, user=target.user, password=target.password
    )
    wanted: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [str(address)],
        # No time at all means one attempt: a refusal is then told from silence by its speed.
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": True,
        "transport/unicast/open_timeout": int(target.timeout * 1000),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,
        **settings(security),
    }
    if target.namespace is not None:
        wanted["namespace"] = target.namespace
    start = time.monotonic()
    try:
        return ZenohSession(open_session(wanted, target.timeout + 2.0))
    except zenoh.ZError:
        if time.monotonic() - start > 0.9 * target.timeout:
            raise UnreachableError from None
        raise


def _why_closed(address: Address, target: Target, silent: bool) -> str:
    if address.scheme == "tcp" and speaks_tls(address, TLS_SECONDS):
        return (
            f"the learner speaks TLS and was spoken to without; write {address.written('tls')}"
            " and give --certs FOLDER"
        )
    if silent:
        return (
            f"port {address.port} accepts connections, but nothing came back within"
            f" {target.timeout:g} s; another program listens there, or the learner hangs"
        )
    if target.user is None:
        return (
            "the learner ended the connection as it was opened; it wants a user and a password:"
            " give --user NAME --password-file FILE (or another program listens there)"
        )
    if _opens_without_user(address, target):
        return (
            f"the learner has no users and refuses user {target.user}; leave out --user, or start"
            " it with a file of users"
        )
    return (
        f"the learner ended the connection as it was opened: user {target.user} is unknown there"
        " or the password is wrong; compare with the learner's file of users"
    )


def _opens_without_user(address: Address, target: Target) -> bool:
    try:
        _connect(address, replace(target, user=None, password=None)).close()
    except (zenoh.ZError, UnreachableError):
        return False
    return True


def _inside(session: ZenohSession, target: Target) -> Iterator[Check]:
    """What an open session is good for."""
    alive, found = _check_ping(session, target)
    yield found
    if alive:
        yield from check_operations(session, operations_of(target.role), _who(target))
    if target.role == "learner":
        text = "what only a learner may do is not tried, it would disturb the run"
        yield Check("publish", SKIPPED, text)


def _check_ping(session: ZenohSession, target: Target) -> tuple[bool, Check]:
    """Whether a learner of this program answers; and whether to ask it more."""
    sample = None
    for _ in range(2):
        # The first question of a session can come before the other side knows its keys.
        try:
            sample = session.query(PING, timeout=ANSWER_SECONDS)
        except zenoh.ZError:
            break
        if sample is not None:
            break
        time.sleep(0.2)
    if sample is None:
        where = f" in the namespace {target.namespace}" if target.namespace else ""
        return False, Check(
            "ping",
            FAILED,
            f"zenoh answers, but no learner does on {PING}{where}; what listens there is a router"
            " without a learner, another program, an older lndrl, or of another --namespace",
        )
    try:
        answer = json.loads(sample.payload.to_bytes())
        version, protocol = str(answer["program_version"])[:40], answer["protocol"]
        run = str(answer.get("run_id") or "without name")[:80]
    except (ValueError, TypeError, KeyError, AttributeError):
        text = f"what answers on {PING} is no learner of lndrl {VERSION}; correct the endpoint"
        return False, Check("ping", FAILED, text)
    same = "install the same version on both sides (`lndrl version`)"
    if protocol != PROTOCOL_VERSION:
        text = (
            f"the learner speaks protocol {str(protocol)[:40]}, this program {PROTOCOL_VERSION}"
            f" (lndrl {version} there, {VERSION} here); {same}"
        )
        return True, Check("ping", FAILED, text)
    if version != VERSION:
        text = f"the learner is lndrl {version}, this is {VERSION}; {same}"
        return True, Check("ping", FAILED, text)
    return True, Check("ping", OK, f"the learner of run {run} answers, lndrl {version}")


def _who(target: Target) -> str:
    """How the learner knows us; never a secret."""
    names = []
    if target.user is not None:
        names.append(f"user {target.user}")
    if target.certificates is not None and target.endpoint.startswith("tls/"):
        from lndrl.doctor.certificate_checks import name_shown

        shown = target.role and name_shown(target.certificates, target.role)
        names.append(f"certificate {shown}" if shown else "no certificate")
    return " with ".join(names) or "a connection without name"
