"""The process of a site's door in a fleet bench."""

from __future__ import annotations

import json
from multiprocessing.connection import Connection
from typing import Any

from lndrl.config import parse_config
from lndrl.machine.files import raise_file_limit


def main(config: dict[str, Any], listen: str, namespace: str, channel: Connection) -> None:
    """Stand between the learner of ``config`` and actors at ``listen`` until the pipe closes."""
    from lndrl.chaos.wire import enter
    from lndrl.transport import Security, open_site

    raise_file_limit()
    run = parse_config(config, "bench fleet")
    if namespace:
        enter(namespace)
    here = run.transport.model_copy(update={"endpoint": listen})
    site = open_site(run.transport.endpoint, here, security=Security("site", insecure=True))
    channel.send_bytes(json.dumps(["ready"]).encode())
    try:
        channel.recv_bytes()  # nobody sends; it ends with the parent
    except (EOFError, OSError):
        pass
    finally:
        site.close()
