"""A page about what goes over the network, from the definitions that both sides share."""

from __future__ import annotations

import dataclasses

from docs.site.reference.text import code, plain, said, table
from lndrl.config import keys as keys_of
from lndrl.transport import keys as key_module
from lndrl.transport.messages import MESSAGES, PROTOCOL_VERSION, Message
from lndrl.transport.security.access import RIGHTS
from lndrl.transport.status import Status


def messages_page() -> str:
    """Keys, rights, messages and the status."""
    return (
        "\n\n".join(
            [
                _opening(),
                f"## Who may what\n\n{_rights()}",
                *(_message(kind) for kind in MESSAGES.values()),
                f"## Status\n\n{said(Status.__doc__)}\n\n{_status()}",
            ]
        )
        + "\n"
    )


def _opening() -> str:
    names = [
        name for name in vars(key_module) if name.isupper() and name not in ("PREFIX", "TESTED")
    ]
    rows = [(code(getattr(key_module, name)), code(name)) for name in names]
    return f"""# Messages

What learner, actors, evaluators, sites and dashboards say to each other over Zenoh, protocol
version {PROTOCOL_VERSION}. A message is msgpack, `{{"kind": ..., "body": ...}}`, and the arrays
that belong to it; it is checked whole before anything of it is used, and nothing is unpickled. A
namespace (`--namespace`) goes before every key.

{table(("key", "in the code"), rows)}"""


def _rights() -> str:
    found: dict[tuple[str, str], list[str]] = {}
    for right in RIGHTS:
        found.setdefault((right.role, right.action), []).append(code(right.key))
    rows = [(role, action, ", ".join(on)) for (role, action), on in found.items()]
    opening = "The one table of access; what is not in it is refused to everybody."
    return f"{opening}\n\n{table(('role', 'may', 'on'), rows)}"


def _message(kind: type[Message]) -> str:
    rows = []
    for each in dataclasses.fields(kind):
        default = each.default
        if default is dataclasses.MISSING:
            made = each.default_factory
            default = "must be given" if made is dataclasses.MISSING else code(repr(made()))
        else:
            default = code(repr(default))
        rows.append((code(each.name), code(each.type), str(default)))
    head = ("field", "type", "default")
    return f"## {kind.KIND}\n\n`{kind.__name__}`: {said(kind.__doc__)}\n\n{table(head, rows)}"


def _status() -> str:
    rows = [
        (code(key.name), plain(key.kind) if key.is_value else "keys", plain(key.description))
        for key in keys_of(Status).values()
    ]
    return table(("key", "may be", "what it is"), rows)
