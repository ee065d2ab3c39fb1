"""What each role must not do, tried; what it must, done: over TLS, and over TCP with users."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from lndrl.transport.keys import (
    ANNOUNCE,
    HELLO,
    OPERATION,
    PING,
    STATUS,
    VALIDATION,
    WEIGHTS,
)
from lndrl.transport.security.access import (
    EVERY_ACTOR,
    EVERY_UPLOAD,
    EVERY_WORLD,
    RIGHTS,
    allowed,
)
from lndrl.transport.security.identity import settings
from tests.lndrl.transport.security.sites import ANYTHING, PATIENCE, Site, Watcher

KEYS = (
    *(HELLO, EVERY_UPLOAD, WEIGHTS, ANNOUNCE, STATUS, VALIDATION, OPERATION, PING),
    *(EVERY_ACTOR, EVERY_WORLD, ANYTHING),
)
NO_WORLD = tuple(key for key in KEYS if key != EVERY_WORLD)
ACTIONS = ("ask", "answer", "hear", "say", "delete", "appear", "watch")

# Everything that whoever is no learner must not do, key by key; the rest is what they are for.
MUST_NOT: dict[str, dict[str, tuple[str, ...]]] = {
    "actor": {
        "ask": (STATUS, VALIDATION, OPERATION, EVERY_ACTOR, EVERY_WORLD, ANYTHING),
        "answer": KEYS,
        "hear": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            STATUS,
            VALIDATION,
            OPERATION,
            PING,
            EVERY_ACTOR,
            EVERY_WORLD,
            ANYTHING,
        ),
        "say": NO_WORLD,
        "delete": KEYS,
        "appear": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            ANNOUNCE,
            STATUS,
            VALIDATION,
            OPERATION,
            PING,
            EVERY_WORLD,
            ANYTHING,
        ),
        "watch": KEYS,
    },
    "dashboard": {
        "ask": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            ANNOUNCE,
            VALIDATION,
            OPERATION,
            EVERY_ACTOR,
            EVERY_WORLD,
            ANYTHING,
        ),
        "answer": KEYS,
        "hear": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            ANNOUNCE,
            VALIDATION,
            OPERATION,
            PING,
            EVERY_ACTOR,
            ANYTHING,
        ),
        "say": KEYS,
        "delete": KEYS,
        "appear": KEYS,
        "watch": KEYS,
    },
    "evaluator": {
        "ask": (
            HELLO,
            EVERY_UPLOAD,
            ANNOUNCE,
            STATUS,
            OPERATION,
            EVERY_ACTOR,
            EVERY_WORLD,
            ANYTHING,
        ),
        "answer": KEYS,
        "hear": KEYS,
        "say": KEYS,
        "delete": KEYS,
        "appear": KEYS,
        "watch": KEYS,
    },
    "operator": {
        "ask": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            ANNOUNCE,
            VALIDATION,
            EVERY_ACTOR,
            EVERY_WORLD,
            ANYTHING,
        ),
        "answer": KEYS,
        "hear": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            ANNOUNCE,
            VALIDATION,
            OPERATION,
            PING,
            EVERY_ACTOR,
            ANYTHING,
        ),
        "say": KEYS,
        "delete": KEYS,
        "appear": KEYS,
        "watch": KEYS,
    },
    "site": {
        "ask": (STATUS, OPERATION, EVERY_ACTOR, EVERY_WORLD, ANYTHING),
        "answer": KEYS,
        "hear": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            STATUS,
            VALIDATION,
            OPERATION,
            PING,
            EVERY_ACTOR,
            EVERY_WORLD,
            ANYTHING,
        ),
        "say": NO_WORLD,
        "delete": KEYS,
        "appear": (
            HELLO,
            EVERY_UPLOAD,
            WEIGHTS,
            ANNOUNCE,
            STATUS,
            VALIDATION,
            OPERATION,
            PING,
            EVERY_WORLD,
            ANYTHING,
        ),
        "watch": KEYS,
    },
}
CASES = [
    (role, action, key)
    for role, actions in MUST_NOT.items()
    for action, keys in actions.items()
    for key in keys
]


def only_ingress(site: Site) -> Path:
    """An overlay that lets everything out, so that what comes in must be stopped on its own."""
    security = site.security("learner", listens=True)
    assert security is not None
    rules = settings(security, listening=True)["access_control"]
    messages = sorted({message for rule in rules["rules"] for message in rule["messages"]})
    rules["rules"].append(
        {
            "id": "all out",
            "permission": "allow",
            "flows": ["egress"],
            "messages": [*messages, "delete"],
            "key_exprs": ["**"],
        }
    )
    for policy in rules["policies"]:
        policy["rules"].append("all out")
    path = site.folder / "overlay.json5"
    path.write_text("// ours, and more\n" + json.dumps({"access_control": rules}))
    return path


@pytest.fixture(scope="module", params=["tls", "users", "tls, ingress alone"])
def guarded(request, tmp_path_factory) -> Iterator[tuple[Watcher, dict[str, zenoh.Session]]]:
    site = Site(request.param.split(",")[0], tmp_path_factory.mktemp("guarded"))
    alone = "ingress" in request.param
    learner = site.learner(**({"overlay": only_ingress(site)} if alone else {}))
    learner.publish_weights(1, b"weights")
    learner.publish_status({"run_id": "run-1"}, [])
    try:
        yield (
            Watcher(learner._session.zenoh),
            {role: site.session(role).zenoh for role in MUST_NOT},
        )
    finally:
        site.close()


@pytest.fixture(scope="module")
def unguarded(tmp_path_factory) -> Iterator[tuple[Watcher, zenoh.Session]]:
    site = Site("open", tmp_path_factory.mktemp("unguarded"))
    try:
        yield Watcher(site.learner()._session.zenoh, PATIENCE), site.session("actor").zenoh
    finally:
        site.close()


@pytest.mark.parametrize(("role", "action", "key"), CASES)
def test_what_a_role_must_not_do_has_no_effect(guarded, role, action, key) -> None:
    watcher, sessions = guarded
    assert not watcher.tries(sessions[role], action, key)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("key", KEYS)
def test_without_rules_each_of_them_has(unguarded, action, key) -> None:
    """Else the test above would prove nothing."""
    watcher, raw = unguarded
    assert watcher.tries(raw, action, key)


def test_the_tables_together_are_all_there_is() -> None:
    for role in MUST_NOT:
        for action in ACTIONS:
            for key in KEYS:
                forbidden = key in MUST_NOT[role][action]
                assert forbidden != allowed(role, action, key), (role, action, key)
    assert {right.key for right in RIGHTS} <= set(KEYS)
