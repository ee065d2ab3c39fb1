#!/usr/bin/env bash
# eclipse-zenoh 1.10.2: of two complete queryables on one key a plain get (target BEST_MATCHING) calls
# one, where they are peers, or clients of one router. Where they are clients of two routers it calls
# both, and so it does where one session has declared the two. The asker does not notice: by its
# default consolidation it is given one reply. What the service does besides replying is done twice.
#
# For services that keep a standby: "complete" alone elects nobody; let the standby declare its
# queryable when it takes over, or make what is asked idempotent.
# Exit 0: it is as described. Exit 1: it has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
"$folder/venv/bin/python" - <<'PYTHON'
import json
import socket
import time
from collections.abc import Callable
from importlib.metadata import version

import zenoh

KEY = "service/answer"


def endpoint() -> str:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


def opened(mode: str, listen: str | None, *connect: str) -> zenoh.Session:
    config = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        "listen": {"endpoints": [listen] if listen else []},
        "connect": {"endpoints": connect},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def called(servers: list[zenoh.Session], asker: zenoh.Session) -> tuple[str, int]:
    """Which of two complete queryables a query has called, and how many replies it got."""
    calls: list[str] = []

    def service(name: str) -> Callable[[zenoh.Query], None]:
        def answer(query: zenoh.Query) -> None:
            calls.append(name)
            query.reply(KEY, name)

        return answer

    kept = [
        session.declare_queryable(KEY, service(name), complete=True)
        for name, session in zip("ab", servers)
    ]
    time.sleep(1.0)  # until all have heard of them
    replies = list(asker.get(KEY, timeout=5.0))
    time.sleep(0.5)
    del kept
    return "".join(sorted(calls)), len(replies)


def in_places() -> dict[str, tuple[str, int]]:
    found = {}

    one, two, three = endpoint(), endpoint(), endpoint()
    peers = [opened("peer", one), opened("peer", two, one), opened("peer", three, one, two)]
    found["two peers"] = called(peers[:2], peers[2])
    for session in peers:
        session.close()

    one = endpoint()
    router = opened("router", one)
    clients = [opened("client", None, one) for _ in range(3)]
    found["two clients of one router"] = called(clients[:2], clients[2])
    for session in [*clients, router]:
        session.close()

    one = endpoint()
    router = opened("router", one)
    clients = [opened("client", None, one) for _ in range(2)]
    found["twice in one client"] = called([clients[0], clients[0]], clients[1])
    for session in [*clients, router]:
        session.close()

    one, two = endpoint(), endpoint()
    routers = [opened("router", one), opened("router", two, one)]
    clients = [opened("client", None, one), *(opened("client", None, two) for _ in range(2))]
    found["a client at either of two routers"] = called(clients[:2], clients[2])
    for session in [*clients, *reversed(routers)]:
        session.close()
    return found


seen = in_places()
print("eclipse-zenoh", version("eclipse-zenoh"))
for place, (calls, replies) in seen.items():
    print(f"{place}: {len(calls)} called, {replies} reply")
expected = {
    "two peers": (1, 1),
    "two clients of one router": (1, 1),
    "twice in one client": (2, 1),
    "a client at either of two routers": (2, 1),
}
counted = {place: (len(calls), replies) for place, (calls, replies) in seen.items()}
raise SystemExit(0 if counted == expected else "it has changed")
PYTHON
