"""zenoh's files for operators, made from the table of access: ``deploy/zenoh/``.

    python -m lndrl.transport.zenoh.deployment FOLDER [NAMESPACE ...]

writes them anew, for the namespaces that share a router if any are named.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lndrl.transport.security.access import ROLES, access_control, subjects
from lndrl.transport.zenoh.config import merged

CERTIFICATES = "certs"
USERS = "users"
_COMMAND = {"operator": "dashboard"}  # that of a role which has none of its own
_ROUTER = {
    "mode": "router",
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "adminspace": {"enabled": False},
    "transport": {
        "unicast": {"max_sessions": 4096},
        "link": {"tx": {"lease": 3000}, "rx": {"max_message_size": 256 * 2**20}},
    },
}


def files(namespaces: Sequence[str] = ("",)) -> dict[str, str]:
    """File name to text. Paths inside are relative to where the program is started."""
    with_tls = {
        "transport": {"link": {"protocols": ["tls"], "tls": _tls("learner", "listen", "connect")}},
        "access_control": access_control(subjects(True, None), namespaces),
    }
    with_users = {
        "transport": {"auth": {"usrpwd": {"dictionary_file": USERS}}},
        "access_control": access_control(subjects(False, ROLES), namespaces),
    }
    found = {
        "learner-tls.json5": _file(
            "A learner that listens at tls/HOST:PORT: lndrl learner --zenoh THIS.",
            with_tls,
        ),
        "learner-users.json5": _file(
            "A learner that listens at tcp/HOST:PORT and knows its users by password.\n"
            "Each name in the users file must stand below, too; --users FILE does that by itself.",
            with_users,
        ),
        "router-tls.json5": _file(
            "A zenoh router of its own (zenohd -c THIS) that learners join with --router.",
            merged(_router("tls/0.0.0.0:7447"), with_tls),
        ),
        "router-users.json5": _file(
            "The same for users with passwords; not encrypted, so for a network you trust.",
            merged(_router("tcp/0.0.0.0:7447"), with_users),
        ),
    }
    for role in ("actor", "dashboard", "evaluator", "operator"):
        tls = {"transport": {"link": {"protocols": ["tls"], "tls": _tls(role, "connect")}}}
        found[f"{role}-tls.json5"] = _file(
            f"A client of the role {role}: lndrl {_COMMAND.get(role, role)} --connect"
            " tls/HOST:PORT --zenoh THIS.",
            tls,
        )
    return found


def write(folder: Path, namespaces: Sequence[str] = ("",)) -> None:
    """Write all files into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files(namespaces).items():
        (folder / name).write_text(text, encoding="utf-8")


def _router(endpoint: str) -> dict[str, Any]:
    return {**_ROUTER, "listen": {"endpoints": [endpoint]}}


def _tls(role: str, *sides: str) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "root_ca_certificate": f"{CERTIFICATES}/ca.pem",
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    for side in sides:
        settings[f"{side}_certificate"] = f"{CERTIFICATES}/{role}.pem"
        settings[f"{side}_private_key"] = f"{CERTIFICATES}/{role}.key"
    return settings


def _file(note: str, settings: dict[str, Any]) -> str:
    made = "Made by `python -m lndrl.transport.zenoh.deployment deploy/zenoh`."
    comments = [f"// {line}" for line in (*note.split("\n"), made)]
    text = json.dumps(settings, indent=2)
    short = re.sub(r'\[\s+("[^\]{]{1,80})\s+\]', lambda m: f"[{_joined(m[1])}]", text)
    return "\n".join([*comments, short, ""])


def _joined(lines: str) -> str:
    return " ".join(lines.split())


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: python -m lndrl.transport.zenoh.deployment FOLDER [NAMESPACE ...]")
    write(Path(sys.argv[1]), sys.argv[2:] or ("",))
