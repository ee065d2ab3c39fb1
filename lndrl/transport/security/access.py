"""Who may do what: one table, from which zenoh's access control is made. Everything else is denied.

zenoh filters each message kind in each direction on its own, and a rule must cover the key
expression that was *declared*: the learner's queryable ``lndrl/upload/**`` needs a rule for
``lndrl/upload/**``, whatever the single uploads are called. Rules know names, not identities:
an actor may upload under another actor's name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lndrl.transport.keys import (
    ACTORS,
    ANNOUNCE,
    HELLO,
    OPERATION,
    PING,
    STATUS,
    UPLOAD,
    VALIDATION,
    WEIGHTS,
    WORLDS,
    in_namespace,
)

ROLES = ("learner", "actor", "dashboard", "evaluator", "operator", "site")
EVERY_UPLOAD = f"{UPLOAD}/**"
EVERY_ACTOR = f"{ACTORS}/**"
EVERY_WORLD = f"{WORLDS}/**"

# Message kinds that come from a client (ingress) and go to it (egress) when it does something.
ACTIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "ask": {"ingress": ("query",), "egress": ("declare_queryable", "reply")},
    "answer": {"ingress": ("declare_queryable", "reply"), "egress": ("query",)},
    "hear": {"ingress": ("declare_subscriber",), "egress": ("put",)},
    "say": {"ingress": ("put",), "egress": ("declare_subscriber",)},
    "appear": {"ingress": ("liveliness_token",), "egress": ()},
    "watch": {
        "ingress": ("declare_liveliness_subscriber", "liveliness_query"),
        "egress": ("liveliness_token",),
    },
}


@dataclass(frozen=True)
class Right:
    """``role`` may take ``action`` (see ACTIONS) on a key expression."""

    role: str
    action: str
    key: str


RIGHTS = (
    *(Right("actor", "ask", key) for key in (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, PING)),
    Right("actor", "hear", ANNOUNCE),
    Right("actor", "appear", EVERY_ACTOR),
    Right("actor", "say", EVERY_WORLD),
    *(Right("dashboard", "ask", key) for key in (STATUS, PING)),
    # A live world is looked at like the status: it asks nothing of the run.
    *(Right("dashboard", "hear", key) for key in (STATUS, EVERY_WORLD)),
    # An operator is a dashboard that may also ask for something.
    *(Right("operator", "ask", key) for key in (STATUS, PING, OPERATION)),
    *(Right("operator", "hear", key) for key in (STATUS, EVERY_WORLD)),
    # What to validate and what came of it are asked and told under one key.
    *(Right("evaluator", "ask", key) for key in (VALIDATION, WEIGHTS, PING)),
    # A site asks for all its actors and evaluators, and they appear through it.
    *(
        Right("site", "ask", key)
        for key in (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, VALIDATION, PING)
    ),
    Right("site", "hear", ANNOUNCE),
    Right("site", "appear", EVERY_ACTOR),
    Right("site", "say", EVERY_WORLD),
    # A learner that is itself the router passes no rule; these serve one behind a router.
    *(
        Right("learner", "answer", key)
        for key in (HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, STATUS, VALIDATION, OPERATION, PING)
    ),
    *(Right("learner", "say", key) for key in (ANNOUNCE, STATUS)),
    Right("learner", "watch", EVERY_ACTOR),
    Right("learner", "ask", PING),
)


@dataclass(frozen=True)
class Subject:
    """How a role is recognised; both must match where both are given."""

    common_names: tuple[str, ...] = ()
    users: tuple[str, ...] = ()


def common_name(role: str) -> str:
    """The common name of a role's certificate."""
    return f"lndrl-{role}"


def role_of(user: str) -> str:
    """The role of a user name: what stands before its first ``-``; may be none of ROLES."""
    return user.partition("-")[0]


def subjects(certificates: bool, users: Sequence[str] | None) -> dict[str, Subject]:
    """Role to subject; a role without a user is left out where ``users`` are what counts."""
    found = {}
    for role in ROLES:
        names = tuple(user for user in users or () if role_of(user) == role)
        if names or (certificates and users is None):
            found[role] = Subject((common_name(role),) if certificates else (), names)
    return found


def allowed(role: str, action: str, key: str) -> bool:
    """Whether the table holds this right, spelled like this."""
    return Right(role, action, key) in RIGHTS


def access_control(
    roles: Mapping[str, Subject], namespaces: Sequence[str] = ("",)
) -> dict[str, Any]:
    """zenoh's ``access_control`` for these roles: default deny, both directions."""
    rules: list[dict[str, Any]] = []
    described: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for role, subject in roles.items():
        # An empty list of names is not "nobody" to zenoh.
        names = {"cert_common_names": subject.common_names, "usernames": subject.users}
        given = {kind: list(values) for kind, values in names.items() if values}
        if not given:
            raise ValueError(f"nothing says who is {role}")
        own = _rules(role, namespaces)
        rules += own
        described.append({"id": role, **given})
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": described,
        "policies": policies,
    }


def _rules(role: str, namespaces: Sequence[str]) -> list[dict[str, Any]]:
    keys: dict[tuple[str, str], list[str]] = {}
    for right in RIGHTS:
        if right.role != role:
            continue
        for flow, messages in ACTIONS[right.action].items():
            for message in messages:
                found = keys.setdefault((flow, message), [])
                found += [in_namespace(right.key, namespace) for namespace in namespaces]
    # What has the same keys in one direction becomes one rule, so that people can read the files.
    alike: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for (flow, message), expressions in keys.items():
        alike.setdefault((flow, tuple(expressions)), []).append(message)
    return [
        {
            "id": f"{role} {flow} {' '.join(messages)}",
            "permission": "allow",
            "flows": [flow],
            "messages": messages,
            "key_exprs": list(expressions),
        }
        for (flow, expressions), messages in alike.items()
    ]
