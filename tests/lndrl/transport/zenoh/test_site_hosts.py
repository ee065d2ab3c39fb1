"""A site behind NAT at the end of a wire: the wire carries every version of the weights once."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from lndrl.chaos.hosts import Hosts, missing
from lndrl.evaluation.sweep.processes import this_program

SIZE = 4_000_000
ACTORS = 4
WHY_NOT = missing(nat=True)
LEARNER = f"""
import random, sys
from lndrl.config import TransportConfig
from lndrl.transport import Ack, Security, Welcome, open_learner

class Handlers:
    def on_hello(self, hello): return Welcome("run", {{}}, 0)
    def on_chunk(self, header, arrays, size): return Ack("accepted")
    def on_malformed(self, reason): pass
    def on_member(self, actor_id, incarnation, alive): pass

config = TransportConfig(endpoint="tcp/192.0.2.1:7447")
learner = open_learner(config, "run", Security("learner", insecure=True))
learner.start(Handlers())
for version in (1, 2):
    learner.publish_weights(version, random.Random(version).randbytes({SIZE}))
    print(version, flush=True)
    sys.stdin.readline()
learner.close()
"""
FETCH = f"""
import sys
from concurrent.futures import ThreadPoolExecutor
from lndrl.config import TransportConfig
from lndrl.transport import Hello, open_actor

config = TransportConfig(endpoint=sys.argv[1])
actors = [open_actor(config.endpoint, config) for _ in range({ACTORS})]
for number, actor in enumerate(actors):
    actor.hello(Hello(f"actor-{{number}}", "life", "here", 1, 1, "0.1"), 60.0)
wanted = int(sys.argv[2])

def fetch(actor):
    while True:
        version, blob = actor.fetch(None, 60.0)
        if version == wanted:
            return len(blob)

with ThreadPoolExecutor({ACTORS}) as pool:
    print(sum(pool.map(fetch, actors)), flush=True)
for actor in actors:
    actor.close()
"""


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "there are hosts")
def test_a_link_carries_each_version_once() -> None:
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with Hosts() as hosts:
        for name in ("learner", "gateway", "site"):
            hosts.add(name)
        hosts.join("gateway", "10.77.0.1/24", "site", "10.77.0.2/24")
        hosts.route("site", by="10.77.0.1")
        hosts.forward("gateway", hide="10.77.0.0/24")
        wire = hosts.wire("learner", "192.0.2.1/24", "gateway", "192.0.2.2/24", delay=0.02)
        program = [sys.executable, "-c"]
        learner = hosts.start("learner", [*program, LEARNER], env=this_program(), **pipes)
        assert learner.stdin is not None and learner.stdout is not None
        assert learner.stdout.readline() == "1\n"
        words = "site --connect tcp/192.0.2.1:7447 --listen tcp/10.77.0.2:7447 --insecure".split()
        site = hosts.start(
            "site", [sys.executable, "-m", "lndrl", *words], env=this_program(),
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert site.stderr is not None
        assert "actors of this site" in site.stderr.readline()
        for version in (1, 2):
            before = wire.carried()[0]
            near = hosts.run(
                "site", [*program, FETCH, "tcp/10.77.0.2:7447", str(version)], env=this_program()
            )
            assert int(near) == ACTORS * SIZE
            # The first version may have come before anybody asked.
            assert wire.carried()[0] - before < 1.3 * SIZE
            learner.stdin.write("\n")
            learner.stdin.flush()
        assert wire.carried()[0] > 2 * SIZE
        site.terminate()
        site.communicate(timeout=60.0)
        learner.communicate(timeout=60.0)
